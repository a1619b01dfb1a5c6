"""Functions compiled to machine code once per machine (numba keeps them on disk), and fast calls of them.

A call begins with a look at the types of all arguments. Where these are named tuples of many arrays, that
look takes longer than a short kernel; `same_types` leaves it out.
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba

from carlaloc_env.core.files.array_cache import machine_code_folder
from carlaloc_env.core.files.file_locks import locked
from carlaloc_env.core.files.source_digest import source_digest

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function on its first call and keep the machine code on disk.

    It is compiled anew when its module or anything that this imports changes. Without fast-math:
    only then are + − × ÷ and √ the same bits on every CPU. Without reference counts, for which
    threads would wait on each other: compiled functions create no arrays.
    """
    return _compiled(function, forceinline=False)


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function that becomes a part of those that call it.

    A call hands over every array as several numbers, which takes longer than a short kernel.
    """
    return _compiled(function, forceinline=True)


def _compiled(function: Callable[P, R], *, forceinline: bool) -> Callable[P, R]:
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": False}
    made: Any = numba.njit(**options, forceinline=forceinline)(function)
    if _has_folder(Path(function.__code__.co_filename).with_name("__pycache__")):
        made.enable_caching()
    kept: Any = getattr(getattr(made, "_cache", None), "_cache_file", None)
    if hasattr(kept, "_source_stamp"):
        # Numba's own stamp is that of the function's file: it would miss a change in a function called.
        kept._source_stamp = source_digest(function.__module__)
        kept._load_index = _index_or_nothing(kept._load_index)
        kept.load = _in_turn(kept.load, made._cache.cache_path)
        kept.save = _in_turn(kept.save, made._cache.cache_path)
    else:
        # A numba that keeps its stamp elsewhere must not lend machine code of older sources.
        made = numba.njit(**options, forceinline=forceinline)(function)
    return cast(Callable[P, R], made)


def _has_folder(beside: Path) -> bool:
    """Whether numba can keep machine code: where the user chose, beside the source, or else in our cache.

    By itself it would then look for a home folder, and fail or make one called ``~`` where there is none.
    """
    writable = os.access(beside if beside.is_dir() else beside.parent, os.W_OK)
    settings: Any = numba.config
    if not settings.CACHE_DIR and not writable:
        settings.CACHE_DIR = str(machine_code_folder() or "")
    return bool(settings.CACHE_DIR) or writable


def _index_or_nothing(load: Callable[[], dict[Any, str]]) -> Callable[[], dict[Any, str]]:
    """Numba's reader of its index, which gives nothing where the index names classes that are gone.

    The index holds the types of arguments beside the stamp: after a class has been renamed, it cannot
    even be read, although its stamp is an old one.
    """

    def index() -> dict[Any, str]:
        try:
            return load()
        except (AttributeError, ImportError):
            return {}

    return index


def _in_turn(use: Callable[P, R], folder: str) -> Callable[P, R]:
    """Numba's reader or writer of kept machine code, for one process at a time in a folder.

    Two that compile a function for other types at once would both call their files number 1, and a reader
    between the new index and the file would get what that number had before.
    """

    def alone(*args: P.args, **kwargs: P.kwargs) -> R:
        with locked(Path(folder, ".numba.lock")):
            return use(*args, **kwargs)

    return alone


def same_types(function: Callable[..., R]) -> Callable[..., R]:
    """A compiled function for a caller whose arguments have the types of the first call at every call.

    Nothing checks that they have: arrays the same data types, axes, order and permission to write. So one
    object makes them all and keeps this function to itself. Arguments are given by position.
    """
    dispatcher: Any = function
    machine_code: Callable[..., R] | None = None

    def call(*arguments: Any) -> R:
        nonlocal machine_code
        if machine_code is None:
            machine_code = dispatcher.compile(tuple(map(numba.typeof, arguments)))
        return machine_code(*arguments)

    return call
