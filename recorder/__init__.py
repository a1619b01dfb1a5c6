"""Everything after the environment: record, replay, write datasets, evaluate.

Public names (docs/api.md) are loaded when they are asked for.
"""

from carlaloc_env.core.lazy_names import lazy_names

__getattr__, __all__ = lazy_names(__name__, __file__)
