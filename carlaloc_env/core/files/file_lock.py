"""Locks on files that the kernel lets go of however the process ends."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

try:
    import fcntl
except ImportError:  # Windows, where an open file cannot be removed, so that it needs no lock.
    fcntl = None  # type: ignore[assignment]


def take_lock(file: IO[Any], *, wait: bool = False) -> bool:
    """Whether nobody else holds the file; it is held by us then, until it is closed.

    Args:
        file: The open file.
        wait: Wait for whoever holds it; False comes then only where files cannot be locked.
    """
    if fcntl is None:
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError:
        return False
    return True


def has_name(file: IO[Any], path: Path) -> bool:
    """Whether an open file is the one at a path; who held it before may have removed it."""
    with suppress(FileNotFoundError):
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    return False
