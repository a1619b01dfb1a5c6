"""Locks on files that the kernel releases when a process ends."""

import logging
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO, Any

try:
    import fcntl
except ImportError:  # Windows, where an open file cannot be removed, so that it needs no lock.
    fcntl = None  # type: ignore[assignment]
_log = logging.getLogger(__name__)


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
    except BlockingIOError:
        return False
    except OSError as error:
        _log.info("files cannot be locked here: %s", error)
    return True


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold a file of this name, which is made where it is missing, so that processes take turns.

    Where files cannot be locked (Windows, some network drives, a folder that cannot be written), no process
    waits for another.
    """
    with ExitStack() as held:
        with suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            file = held.enter_context(path.open("a"))
            if not take_lock(file):
                _log.info("waiting for another process that holds %s", path)
                take_lock(file, wait=True)
        yield


def has_name(file: IO[Any], path: Path) -> bool:
    """Whether an open file is the one at a path; who held it before may have removed it."""
    with suppress(FileNotFoundError):
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    return False
