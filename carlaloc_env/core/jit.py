"""Functions compiled to machine code, once per machine: numba keeps them on disk.

Compiled functions called without the look at their arguments' types with which every call begins.

Where arguments are named tuples of many arrays, that look takes longer than a short kernel.

The cores that a process may use.
"""

import functools
import math
import os
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba

from carlaloc_env.core.files.array_cache import machine_code_folder
from carlaloc_env.core.files.output_paths import locked
from carlaloc_env.core.files.source_digest import source_digest

P = ParamSpec("P")
R = TypeVar("R")

BAND_ROWS = 24
"""Rows of one band; bands do not depend on the number of threads, so results do not either."""


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function on its first call and keep the machine code on disk.

    It is compiled anew when its module or anything that this imports changes. Without fast-math:
    only then are + − × ÷ and √ the same bits on every CPU. Without reference counts, for which
    threads would wait on each other: compiled functions create no arrays.
    """
    return _compiled(function, forceinline=False)


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """The same for a function that becomes a part of those that call it.

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


def usable_cores(root: Path = Path("/")) -> tuple[int, ...]:
    """Numbers of the cores that this process may use: of its affinity, as many as its container is granted.

    Args:
        root: Folder of the system's files.
    """
    affinity = getattr(os, "sched_getaffinity", lambda _: range(os.cpu_count() or 1))
    found = tuple(sorted(affinity(0)))
    return found[: max(math.ceil(min(_granted(root), len(found))), 1)]


@functools.cache
def _granted(root: Path) -> float:
    """Cores that the control groups of this process, of version 1 or 2, grant it; infinite: no limit."""
    granted = math.inf
    with suppress(OSError, ValueError):
        for line in (root / "proc/self/cgroup").read_text(encoding="utf-8").splitlines():
            _, controllers, group = line.split(":", 2)
            if controllers and "cpu" not in controllers.split(","):
                continue
            below = Path(group.strip("/"))
            # A group has at most what those above it have; a container may see itself as the topmost.
            for folder in (below, *below.parents):
                place = root / "sys/fs/cgroup" / ("cpu" if controllers else "") / folder
                granted = min(granted, _quota(place))
    return granted


def _quota(group: Path) -> float:
    """Cores that one control group grants; infinite: no limit."""
    for names in (("cpu.max",), ("cpu.cfs_quota_us", "cpu.cfs_period_us")):
        # "max" is no number.
        with suppress(OSError, ValueError):
            quota_us, period_us = " ".join((group / name).read_text() for name in names).split()
            if int(quota_us) > 0:
                return int(quota_us) / int(period_us)
    return math.inf


def over_bands(function: Callable[[int, int], R], rows: int, band_rows: int = BAND_ROWS) -> list[R]:
    """Results of a function of (first row, end row) for all bands of an image, from the top down."""
    bands = [(first, min(first + band_rows, rows)) for first in range(0, rows, band_rows)]
    threads = min(len(usable_cores()), len(bands), 8)
    if threads <= 1:
        return [function(*band) for band in bands]
    found: dict[int, R] = {}
    failed: list[BaseException] = []
    pending = iter(range(len(bands)))

    def work() -> None:
        # Threads of its own that each take the next band cost a tenth of an executor's.
        try:
            for number in pending:
                found[number] = function(*bands[number])
        except BaseException as error:
            failed.append(error)

    helpers = [threading.Thread(target=work) for _ in range(threads - 1)]
    for helper in helpers:
        helper.start()
    work()
    for helper in helpers:
        helper.join()
    if failed:
        raise failed[0]
    return [found[number] for number in range(len(bands))]


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
