"""CarlaLoc: a driving world, a SLAM sensor suite and a dataset factory.

Importing the package registers its Gymnasium environments and starts nothing; its public names
(docs/api.md) are loaded when they are asked for.
"""

from gymnasium.envs.registration import register

from carlaloc_env.core.lazy_names import lazy_names

__version__ = "0.1.0"

TOWNS = ("Town01", "Town03", "Town04", "Town05", "Town06", "Town07", "Town10")
"""Towns that come with the package, each as `CarlaLoc-<town>-v0`."""

_ENTRY_POINT = "carlaloc_env.envs.carlaloc_env:CarlaLocEnv"
register(id="CarlaLoc-v0", entry_point=_ENTRY_POINT)
for _town in (*TOWNS, "Town10HD"):
    register(id=f"CarlaLoc-{_town}-v0", entry_point=_ENTRY_POINT, kwargs={"map": _town})
register(id="CarlaLoc-AnyTown-v0", entry_point="carlaloc_env.envs.carlaloc_env:AnyTownEnv")

__getattr__, _names = lazy_names(__name__, __file__)
__all__ = [*_names, "TOWNS", "__version__"]
