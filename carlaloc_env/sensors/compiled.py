"""Kernels over pixels: compiled by numba, run on bands of rows by several threads."""

from __future__ import annotations

import functools
import hashlib
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])
T = TypeVar("T")

BAND_ROWS = 24
"""Rows of one band; bands do not depend on the number of threads, so results do not either."""


def kernel(function: F) -> F:
    """Compile a function on its first call and keep the machine code on disk.

    Without fast-math, so that + − × ÷ and √ give the same bits on every CPU. Without reference
    counts, for which threads would wait on each other: kernels create no arrays.
    """
    options: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy", "_nrt": False}
    made: Any = numba.njit(**options)(function)
    # Numba looks at a function's own file only; kernels call those of other files in this folder.
    kept: Any = getattr(getattr(made, "_cache", None), "_cache_file", None)
    if kept is not None and hasattr(kept, "_source_stamp"):
        kept._source_stamp = _stamp()
    result: F = made
    return result


def over_bands(function: Callable[[int, int], T], rows: int) -> list[T]:
    """Results of a function of (first row, end row) for all bands of a picture, from the top down."""
    bands = [(first, min(first + BAND_ROWS, rows)) for first in range(0, rows, BAND_ROWS)]
    threads = min(os.cpu_count() or 1, len(bands), 8)
    if threads == 1:
        return [function(*band) for band in bands]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(lambda band: function(*band), bands))


@functools.cache
def _stamp() -> str:
    digest = hashlib.blake2b(digest_size=16)
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    return digest.hexdigest()
