"""Locks on files that the kernel releases when a process ends, and claims where locks exclude nobody."""

import logging
import os
import platform
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


def claim(path: Path, file: IO[Any]) -> str | None:
    """Lock a file, and claim its place for this process by host and number.

    The claim holds where locks exclude nobody, as over NFS. That of a process of this machine which has died
    is taken over. It is a link to its text: such a link is made at once or not at all, by one process alone.
    On a disk without links, the lock has to do.

    Args:
        path: Where the claim lies; to give it up, remove it.
        file: An open file at that place.

    Returns:
        Who has the place, as ``process 42 on host a``; None: it is ours until the file is closed.
    """
    if not take_lock(file):
        holder = claimed_by(path)
        return "an unknown process" if holder is None else f"process {holder[2]} on host {holder[0]}"
    mine = (platform.node(), _boot(), str(os.getpid()))
    while True:
        try:
            path.symlink_to(" ".join(mine))
            return None
        except FileExistsError:
            holder = claimed_by(path)
        except OSError:
            return None
        if holder is not None:
            host, boot, pid = holder
            if mine[0] != host and mine[1] != boot:
                return f"process {pid} on host {host} (if it has ended there, delete {path})"
            if mine[1] == boot and not _excludes(file) and _lives(int(pid)):
                return f"process {pid} on host {host}"
        path.unlink(missing_ok=True)


def claimed_by(path: Path) -> tuple[str, str, str] | None:
    """Host, its boot and process of a claim; None: there is no claim."""
    with suppress(OSError, ValueError):
        host, boot, pid = str(path.readlink()).split(" ")
        return host, boot, str(int(pid))
    return None


def _boot() -> str:
    """What no two machines, and no two starts of one, have in common; containers of a machine share it."""
    with suppress(OSError):
        return Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
    return platform.node()


def _excludes(file: IO[Any]) -> bool:
    """Whether the lock that this process has on a file keeps others out, on this machine at least."""
    with Path(file.name).open("rb") as other:
        return not take_lock(other)


def _lives(pid: int) -> bool:
    """Whether this machine has a process of this number."""
    # On Windows a signal of 0 would be a Ctrl-C.
    if os.name == "posix":
        try:
            os.kill(pid, 0)
        except OSError as error:
            return isinstance(error, PermissionError)
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
