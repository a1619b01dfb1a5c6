"""Functions compiled to machine code, once per machine: numba keeps them on disk."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function on its first call.

    Without fast-math: only then are + − × ÷ and √ the same bits on every CPU. Without reference
    counts: compiled functions create no arrays.
    """
    options: dict[str, Any] = {"cache": True, "error_model": "numpy", "_nrt": False}
    made: Any = numba.njit(**options)(function)
    # Numba forgets what it kept when the function's own file changes, but not when one that it calls does.
    kept: Any = getattr(getattr(made, "_cache", None), "_cache_file", None)
    if kept is not None and hasattr(kept, "_source_stamp"):
        kept._source_stamp = _stamp()
    return cast(Callable[P, R], made)


@functools.cache
def _stamp() -> str:
    """Digest of all sources of this package."""
    digest = hashlib.blake2b(digest_size=16)
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    return digest.hexdigest()
