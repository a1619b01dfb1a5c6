"""Arrays kept on disk: written under another name first, checked on reading, made anew when damaged.

Their files are named after all that they come from, so that a change of the code, of a library or of the
content makes a new file; those used longest ago go.

Arrays that processes share: views of a file of the cache, whose pages are in memory once for all.

What a process has freed, given back to the system.
"""

import ctypes
import hashlib
import json
import logging
import math
import mmap
import os
import re
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.errors import OutputError
from carlaloc_env.core.files.output_paths import atomic_write, locked, user_folder
from carlaloc_env.core.files.source_digest import source_digest


def give_back_freed_memory() -> None:
    """Return pages that were freed to the system, where the C library keeps them (glibc); else nothing.

    Building a scene takes some hundred megabytes for a moment, which glibc would hold for good.
    """
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)


def give_back_mapped_pages(array: NDArray[Any]) -> None:
    """Let go of the pages of the whole file that an array is a view of; they are read again when needed.

    Other arrays are left alone, and so are all on systems that cannot do it.
    """
    base: Any = array
    while base is not None and not isinstance(base, mmap.mmap):
        base = getattr(base, "base", None)
    if base is not None and hasattr(mmap, "MADV_DONTNEED"):
        base.madvise(mmap.MADV_DONTNEED)


_log = logging.getLogger(__name__)
"""Log of misses."""

Arrays = dict[str, NDArray[Any]]
"""Arrays by name."""
T = TypeVar("T")

SIGNATURE = b"carlaloc arrays 1\n"
"""First bytes of a file of arrays."""
ALIGNED_BYTES = 64
"""Values of each array begin at a multiple of this, so that they can be used where they lie."""
_KEY = re.compile(r"-[0-9a-f]+")
"""Digest at the end of a folder's name."""
_KEPT = re.compile(r"[^.].*-[0-9a-f]{32}\.[a-z]+")
"""Name of a kept file."""


def default_cache_dir() -> Path:
    """`$CARLALOC_CACHE`, or `carlaloc` in `$XDG_CACHE_HOME` or `~/.cache`.

    Where that cannot be used, as without a home, it is a folder of this user's among temporary files. A
    line in the log names it once; processes that this one starts take it over.
    """
    folder = Path(os.devnull)
    try:
        base = os.environ.get("XDG_CACHE_HOME", "")
        # A relative path there is not valid (XDG Base Directory Specification).
        folder = user_folder("CARLALOC_CACHE", f"{base if Path(base).is_absolute() else '~/.cache'}/carlaloc")
        fault = _unusable(folder)
    except OutputError as error:
        fault = str(error)
    if fault is not None:
        with suppress(OSError):
            other = Path(tempfile.gettempdir(), f"carlaloc-{getattr(os, 'getuid', int)()}")
            other.mkdir(mode=0o700, exist_ok=True)
            if _unusable(other) is None:
                _log.warning("cache in %s: %s; $CARLALOC_CACHE names another", other, fault)
                os.environ["CARLALOC_CACHE"] = str(other)
                return other
    return folder


def _unusable(folder: Path) -> str | None:
    """Why nothing can be kept in a folder, which need not exist; None: it can."""
    places = (folder.absolute(), *folder.absolute().parents)
    above = next(place for place in places if os.access(place, os.F_OK))
    if not (above.is_dir() and os.access(above, os.W_OK | os.X_OK)):
        return f"{folder} cannot be written"
    fault = _distrust(folder)
    return None if fault is None else f"{folder} {fault}"


def machine_code_folder() -> Path | None:
    """Folder of our cache for machine code; None: there is none that this user alone can write to."""
    folder = default_cache_dir() / "numba"
    return folder if _unusable(folder.parent) is None and _distrust(folder) is None else None


def cache_bound_bytes() -> float:
    """Size that the cache keeps to [bytes]: `$CARLALOC_CACHE_GB`, else 10 GB."""
    try:
        return 1e9 * float(os.environ["CARLALOC_CACHE_GB"])
    except (KeyError, ValueError):
        return 1e10


def cache_files(folder: Path | None = None) -> list[tuple[Path, int]]:
    """Kept files and their sizes [bytes], the file that was used longest ago first.

    Args:
        folder: Where files lie; `default_cache_dir` when left out.
    """
    found = []
    for path in (folder or default_cache_dir()).glob("*-*"):
        # Another process may delete a file meanwhile.
        with suppress(OSError):
            if _KEPT.fullmatch(path.name):
                found.append((path, path.stat().st_size))
    return sorted(found, key=lambda kept: _used_s(kept[0]))


def clear_cache(bound_bytes: float = 0.0, *, stays: Path | None = None) -> int:
    """Delete the files that were used longest ago, until the rest keeps to a bound.

    Args:
        bound_bytes: The bound.
        stays: A file that is not deleted, in the folder of the cache.

    Returns:
        Size of the deleted files [bytes].
    """
    files = cache_files(stays.parent if stays else None)
    whole = left = sum(size for _, size in files)
    for path, size in files:
        if left > bound_bytes and path != stays:
            path.unlink(missing_ok=True)
            left -= size
    return whole - left


def content_hash(*parts: bytes) -> str:
    """Hash of several byte strings, 32 hexadecimal digits; lengths count, so that parts cannot shift."""
    digest = hashlib.blake2b(digest_size=16)
    for part in parts:
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()


def cached(
    name: str,
    kind: str,
    *,
    module: str,
    make: Callable[[], T],
    to_arrays: Callable[[T], Arrays],
    from_arrays: Callable[[Arrays], T],
    content: str = "",
    kept_files: int,
    folder: Path | None = None,
) -> T:
    """What a module makes, from the cache when the same code made it of the same content before.

    A cache that cannot be read is a miss, one that cannot be written is done without, and so is one that
    belongs to somebody else or that everybody can write to; the log tells.

    Args:
        name: Beginning of the file's name, such as ``Town03``.
        kind: Its suffix without the dot, such as ``town``.
        module: Module that makes it; a change in its imports outdates the file.
        make: Makes it anew.
        to_arrays: Turns it into named arrays.
        from_arrays: Turns named arrays into it; KeyError, ValueError and IndexError say that they do not fit.
        content: What else it is made of.
        kept_files: Files of this name and kind that are kept, of this version and earlier ones.
        folder: Where files lie; `default_cache_dir` when left out.
    """
    key = content_hash(content.encode(), source_digest(module).encode())
    stored = (folder or default_cache_dir()) / f"{name}-{key}.{kind}"
    for path in (stored.parent, stored):
        if (fault := _distrust(path)) is not None:
            _log.warning("cache is not used: %s %s; set $CARLALOC_CACHE to a folder of your own", path, fault)
            return make()
    before = _inode(stored)
    kept = _read(stored, from_arrays)
    if kept is not None:
        with suppress(OSError):
            os.utime(stored)
        return kept
    with locked(stored.with_name(f".{name}.{kind}.lock")):
        # Another process may have made it meanwhile.
        kept = None if _inode(stored) == before else _read(stored, from_arrays)
        return _made(stored, make, to_arrays, kept_files) if kept is None else kept


def _inode(path: Path) -> int | None:
    """Number of the file that has this name now, if any."""
    with suppress(OSError):
        return path.stat().st_ino
    return None


def _read(stored: Path, from_arrays: Callable[[Arrays], T]) -> T | None:
    """What lies in the cache; None: nothing that can be used."""
    arrays = load(stored)
    if arrays is None:
        return None
    try:
        return from_arrays(arrays)
    except (KeyError, ValueError, IndexError) as error:
        _log.warning("cached file %s cannot be used (%s) and will be made again", stored, error)
        return None


def _made(stored: Path, make: Callable[[], T], to_arrays: Callable[[T], Arrays], kept_files: int) -> T:
    """What is made anew, and kept where that can be done."""
    with suppress(OSError):
        stored.unlink(missing_ok=True)
    begin = time.perf_counter()
    made = make()
    _log.info("made %s in %.1f s", stored.name, time.perf_counter() - begin)
    try:
        save(stored, to_arrays(made))
        _drop_old(stored, kept_files)
        clear_cache(cache_bound_bytes(), stays=stored)
    except (OSError, OutputError) as error:
        _log.warning("%s cannot be cached: %s", stored.name, error)
    return made


def _distrust(path: Path) -> str | None:
    """Why what lies there might come from somebody else, or None; what is missing comes from nobody."""
    if not hasattr(os, "geteuid"):
        return None
    try:
        found = path.stat()
    except OSError:
        return None
    if found.st_uid != os.geteuid():
        return "belongs to another user"
    return "is writable by all users" if found.st_mode & stat.S_IWOTH else None


def _drop_old(kept: Path, count: int) -> None:
    """Delete the files that were used longest ago, until with the one that is kept `count` are left."""
    name = kept.stem.rpartition("-")[0]
    others = [
        path
        for path in kept.parent.glob(f"{name}-*")
        if path != kept and _KEY.fullmatch(path.stem, len(name))
    ]
    for path in sorted(others, key=_used_s)[: max(len(others) - count + 1, 0)]:
        path.unlink(missing_ok=True)


def _used_s(path: Path) -> float:
    """When a file was used last [s]; another process may have deleted it meanwhile."""
    with suppress(OSError):
        return path.stat().st_mtime
    return 0.0


def arrays_hash(arrays: Mapping[str, NDArray[Any]]) -> str:
    """Hash of named arrays with their types and shapes, 32 hexadecimal digits."""
    # Processors have instructions for SHA-256: towns are large, and each load looks at every byte.
    digest = hashlib.sha256()
    for name in sorted(arrays):
        value = np.ascontiguousarray(arrays[name])
        digest.update(f"{name}/{value.dtype.str}/{value.shape}".encode())
        digest.update(value.data.cast("B") if value.size else b"")
    return digest.hexdigest()[:32]


def save(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write named arrays and their hash; the name `path` never holds a half-written file.

    After the signature come the length of a JSON table (8 bytes), the table, and the values themselves.
    """
    rows, end = {}, 0
    for name, value in arrays.items():
        start = -(-end // ALIGNED_BYTES) * ALIGNED_BYTES
        rows[name] = (value.dtype.str, value.shape, start)
        end = start + value.nbytes
    table = json.dumps({"hash": arrays_hash(arrays), "arrays": rows}).encode()
    with atomic_write(path, advice="set $CARLALOC_CACHE to another folder") as part, part.open("wb") as out:
        out.write(SIGNATURE + len(table).to_bytes(8, "little") + table)
        first = _first_byte(len(table))
        for name, (_, _, start) in rows.items():
            out.seek(first + start)
            out.write(np.ascontiguousarray(arrays[name]).data)
        out.truncate(first + end)


def load(path: Path) -> Arrays | None:
    """Named arrays of a file, or None when it is missing or damaged.

    They are views of the file, mapped into memory: nobody can write to them, and processes share them.
    """
    if not path.is_file():
        return None
    try:
        arrays, mark = _mapped(path)
    except (OSError, ValueError, KeyError, TypeError) as error:
        _log.warning("cached file %s is damaged (%s) and will be made again", path, error)
        return None
    if mark != arrays_hash(arrays):
        _log.warning("cached file %s does not match its hash and will be made again", path)
        return None
    # The check has read all of it, and often little is needed.
    give_back_mapped_pages(next(iter(arrays.values())))
    return arrays


def _mapped(path: Path) -> tuple[Arrays, str]:
    """Arrays of a file as views of it, and the hash that they had."""
    content = np.memmap(path, dtype=np.uint8, mode="r").view(np.ndarray)
    begin = len(SIGNATURE) + 8
    if content[: len(SIGNATURE)].tobytes() != SIGNATURE:
        raise ValueError("it is no file of arrays")
    size = int.from_bytes(content[len(SIGNATURE) : begin].tobytes(), "little")
    table = json.loads(content[begin : begin + size].tobytes())
    values = content[_first_byte(size) :]
    arrays: Arrays = {}
    for name, (kind, shape, start) in table["arrays"].items():
        dtype = np.dtype(kind)
        own = values[start : start + math.prod(shape) * dtype.itemsize]
        arrays[name] = own.view(dtype).reshape(shape)
    return arrays, str(table["hash"])


def _first_byte(table_bytes: int) -> int:
    return -(-(len(SIGNATURE) + 8 + table_bytes) // ALIGNED_BYTES) * ALIGNED_BYTES


SHARED_FROM_BYTES = 1 << 20
"""Smaller arrays have memory of their own."""


def read_only(arrays: Arrays) -> Arrays:
    """Views to which nobody can write, as to those of a file, so that one compiled function takes both."""
    views = {name: value.view() for name, value in arrays.items()}
    for value in views.values():
        value.setflags(write=False)
    return views


def in_shared_memory(arrays: Arrays, name: str, kind: str, *, module: str, kept_files: int) -> Arrays:
    """The same arrays, read-only, in a file of the cache if they are large.

    What nobody reads need not be in memory at all.

    Args:
        arrays: Arrays by name.
        name: Beginning of the file's name.
        kind: Its suffix without the dot.
        module: Module that made them.
        kept_files: Files of this name that are kept.
    """
    views = read_only(arrays)
    if sum(value.nbytes for value in views.values()) < SHARED_FROM_BYTES:
        return views
    return cached(
        name,
        kind,
        module=module,
        make=lambda: views,
        to_arrays=lambda made: made,
        from_arrays=lambda found: {name: found[name] for name in views},
        content=arrays_hash(views),
        kept_files=kept_files,
    )
