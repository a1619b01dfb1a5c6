"""Finished towns on disk: written under another name first, checked on reading, rebuilt when damaged."""

from __future__ import annotations

import hashlib
import io
import logging
import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_log = logging.getLogger(__name__)

Arrays = dict[str, NDArray[Any]]


def default_cache_dir() -> Path:
    """`$CARLALOC_CACHE`, or `~/.cache/carlaloc`."""
    chosen = os.environ.get("CARLALOC_CACHE")
    return Path(chosen) if chosen else Path.home() / ".cache" / "carlaloc"


def content_hash(*parts: bytes) -> str:
    """Hash of several byte strings, 32 hexadecimal digits; lengths count, so that parts cannot shift."""
    digest = hashlib.blake2b(digest_size=16)
    for part in parts:
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()


def arrays_hash(arrays: Mapping[str, NDArray[Any]]) -> str:
    """Hash of named arrays with their types and shapes, 32 hexadecimal digits."""
    digest = hashlib.blake2b(digest_size=16)
    for name in sorted(arrays):
        value = np.ascontiguousarray(arrays[name])
        digest.update(f"{name}/{value.dtype.str}/{value.shape}".encode())
        digest.update(value.data.cast("B") if value.size else b"")
    return digest.hexdigest()


def save(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write named arrays and their hash; the name `path` never holds a half-written file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with partial.open("wb") as out:
            mark = np.frombuffer(arrays_hash(arrays).encode(), dtype=np.uint8)
            np.savez(out, allow_pickle=False, **{**arrays, "hash": mark})
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def load(path: Path) -> Arrays | None:
    """Named arrays of a file, or None when it is missing or damaged."""
    if not path.is_file():
        return None
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        mark = arrays.pop("hash").tobytes().decode()
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        _log.warning("cached town %s is damaged (%s) and will be built again", path, error)
        return None
    if mark != arrays_hash(arrays):
        _log.warning("cached town %s does not match its hash and will be built again", path)
        return None
    return arrays
