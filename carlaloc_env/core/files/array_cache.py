"""Cache on disk: results named after all that they come from, and made anew when damaged.

A change of the code, of a library or of the content makes a new file; the files used longest ago are deleted.
"""

import hashlib
import logging
import os
import re
import stat
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from carlaloc_env.core.errors import OutputError
from carlaloc_env.core.files.array_files import Arrays, load, save
from carlaloc_env.core.files.file_locks import locked
from carlaloc_env.core.files.output_paths import user_folder
from carlaloc_env.core.files.source_digest import source_digest

_log = logging.getLogger(__name__)
"""Log of misses."""
T = TypeVar("T")
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
    files = []
    for path in (folder or default_cache_dir()).glob("*-*"):
        # Another process may delete a file meanwhile.
        with suppress(OSError):
            if _KEPT.fullmatch(path.name):
                files.append((path, path.stat().st_size))
    return sorted(files, key=lambda kept: _used_s(kept[0]))


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
    """Result of a module, from the cache when the same code made it of the same content before.

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
        status = path.stat()
    except OSError:
        return None
    if status.st_uid != os.geteuid():
        return "belongs to another user"
    return "is writable by all users" if status.st_mode & stat.S_IWOTH else None


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
