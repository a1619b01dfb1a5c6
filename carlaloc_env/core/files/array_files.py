"""Files of named arrays with their hash: written whole or not at all, read as views, refused when damaged."""

import hashlib
import json
import logging
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.files.atomic_files import atomic_write
from carlaloc_env.core.freed_memory import give_back_mapped_pages

_log = logging.getLogger(__name__)
"""Log of misses."""
Arrays = dict[str, NDArray[Any]]
"""Arrays by name."""
SIGNATURE = b"carlaloc arrays 1\n"
"""First bytes of a file of arrays."""
ALIGNED_BYTES = 64
"""Values of each array begin at a multiple of this, so that they can be used where they lie."""


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
