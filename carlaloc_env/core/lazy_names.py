"""Names that a package lends from its modules, imported when first asked for (PEP 562).

The list stands in the package's stub, ``__init__.pyi``, where type checkers and editors read it as well.
"""

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any


def lazy_names(package: str, file: str) -> tuple[Callable[[str], Any], list[str]]:
    """A package's `__getattr__` and its names.

    Args:
        package: The package's `__name__`.
        file: Its `__file__`; every ``from module import name as name`` of the stub beside it is a name.
    """
    tree = ast.parse(Path(file).with_suffix(".pyi").read_text(encoding="utf-8"))
    module_of = {
        alias.name: node.module or ""
        for node in tree.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        if alias.asname == alias.name
    }

    def get(name: str) -> Any:
        if name not in module_of:
            raise AttributeError(f"module '{package}' has no attribute '{name}'", name=name)
        value = getattr(import_module(module_of[name]), name)
        # The next look finds it without a call.
        setattr(sys.modules[package], name, value)
        return value

    return get, sorted(module_of)
