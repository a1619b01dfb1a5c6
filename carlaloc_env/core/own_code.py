"""Finds what users write themselves by its name: ``mine.py:NAME`` or ``package.module:NAME``.

It is imported as a module, so that worker processes find the same classes.
"""

import sys
from importlib import import_module
from pathlib import Path
from typing import TypeVar

from carlaloc_env.core.errors import ConfigError

T = TypeVar("T")


def own_object(word: str, kind: type[T]) -> T:
    """An object of a user's file or module, whose code runs as that of any script does.

    A file's folder, or that of work, comes last among the places where Python looks for modules.

    Args:
        word: ``mine.py:NAME`` or ``package.module:NAME``.
        kind: Class of the object.

    Raises:
        ConfigError: there is no such object, or it is another thing.
    """
    place, _, name = word.rpartition(":")
    path = Path(place).resolve() if place.endswith(".py") else None
    folder, module = (str(path.parent), path.stem) if path is not None else (str(Path.cwd()), place)
    if folder not in sys.path:
        sys.path.append(folder)
    try:
        code = import_module(module)
        if path is not None and Path(code.__file__ or "").resolve() != path:
            raise ConfigError(f"{place}: Python has another module '{module}'; rename the file")
        found = getattr(code, name)
    except (ImportError, SyntaxError, AttributeError, ValueError) as error:
        raise ConfigError(f"{word}: {error}; give FILE.py:NAME, or MODULE:NAME of PYTHONPATH") from error
    if not isinstance(found, kind):
        raise ConfigError(f"{word} is no {kind.__name__}, but {type(found).__name__}; name another object")
    return found


def absolute_word(word: str) -> str:
    """A word that names an object of a file, by the file's absolute path; any other word as it is."""
    place, _, name = word.rpartition(":")
    return f"{Path(place).resolve()}:{name}" if place.endswith(".py") else word
