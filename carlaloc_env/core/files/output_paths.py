"""Outputs: whether they may be written, whole or not at all, and by one process at a time.

Whether an output may be written: the one rule of all commands and of all that they call.

Files and folders that are written whole or not at all: under a temporary name first, renamed at the end.

The temporary name of ``NAME`` is ``.NAME.part``, in the same folder, since a rename cannot cross disks. A
killed process leaves it behind, and the next one that writes ``NAME`` removes it.

There is no fsync here. A killed process needs none, and after a power cut these files can be made again,
while one fsync a file would slow down a dataset of thousands. Recordings (`recorder.episode`) cannot be made
again, and spools of units (`recorder.replaying`) are trusted by later runs: both call fsync themselves.

Locks on files that the kernel lets go of however the process ends, and claims that hold where such locks
exclude nobody.
"""

import errno
import logging
import os
import platform
import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from carlaloc_env.core.errors import CarlaLocError, OutputError

EPISODE_SUFFIX = ".mcap"
"""Suffix of episodes. A drive cannot be made again, so that no message proposes to overwrite one."""


def check_output_file(path: str | Path, *, suffixes: Sequence[str] = (), overwrite: bool = False) -> Path:
    """Path of a file, if it may be written: its suffix fits, and nothing is lost by it.

    Args:
        path: The file.
        suffixes: Those that fit, in lower case, with their dot; none: any. They are looked at first, so
            that not even `overwrite` puts a table in the place of an episode.
        overwrite: Whether an older file is replaced.

    Raises:
        OutputError: the suffix is another one, the file exists, or it or its folder is of the wrong sort.
    """
    path = Path(path)
    if suffixes and path.suffix.lower() not in suffixes:
        raise OutputError(f"{path} does not end in {' or '.join(suffixes)}; give a name that does")
    if path.is_dir():
        raise OutputError(f"{path} is a folder; give the name of a file")
    if not overwrite and (path.exists() or path.is_symlink()):
        if path.suffix.lower() == EPISODE_SUFFIX:
            raise OutputError(f"{path} exists; choose another name, or move it away first")
        raise OutputError(f"{path} exists; choose another name, or replace it with --force")
    _check_parents(path)
    return path


def check_output_folder(path: str | Path, *, files: Sequence[str] = (), overwrite: bool = False) -> Path:
    """Path of a folder, if files may be written into it.

    Args:
        path: The folder; it need not exist.
        files: Names of files that will be written there.
        overwrite: Whether older ones are replaced.

    Raises:
        OutputError: it is no folder, or one of the files exists.
    """
    path = Path(path)
    if path.exists() and not path.is_dir():
        raise OutputError(f"{path} is no folder; give another name")
    _check_parents(path)
    for name in files:
        check_output_file(path / name, overwrite=overwrite)
    return path


def path_below(folder: str | Path, name: str | Path) -> Path:
    """Path of something in a folder; what files of others name is opened through this alone.

    Args:
        folder: The folder.
        name: Name, or path relative to it.

    Raises:
        OutputError: it lies outside, be it by ``..``, as an absolute path or through a link.
    """
    path = Path(folder) / name
    if not path.resolve().is_relative_to(Path(folder).resolve()) or Path(name) == Path():
        raise OutputError(f"{str(name)!r} leads out of {folder}; give a name without folders")
    return path


def user_folder(variable: str, otherwise: str) -> Path:
    """Folder that an environment variable names, or `otherwise`; ``~`` is the home folder in both.

    Raises:
        OutputError: there is no home folder.
    """
    try:
        return Path(os.environ.get(variable) or otherwise).expanduser()
    except RuntimeError as error:
        raise OutputError(f"this user has no home folder; set HOME or {variable}") from error


def _check_parents(path: Path) -> None:
    above = next((folder for folder in path.absolute().parents if folder.exists()), None)
    if above is not None and not above.is_dir():
        raise OutputError(f"cannot write {path}: {above} is no folder; choose another place")


@contextmanager
def atomic_write(
    path: Path, error: type[CarlaLocError] = OutputError, advice: str = "choose another place"
) -> Iterator[Path]:
    """Give the temporary path of a file or folder, which takes its name when the block ends.

    An exception in the block removes the unfinished file, and leaves an older one unchanged. A library that
    cuts its file on a full disk without an exception fails here, too.

    Args:
        path: Final path; folders above it are made.
        error: Kind of the error raised.
        advice: End of its message: what to do next.

    Raises:
        CarlaLocError: of this kind; the block, or the rename, raised an OSError.
    """
    part = part_path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        remove(part)
        yield part
        check_room(path)
        part.replace(path)
    except OSError as fault:
        raise error(f"cannot write {path}: {fault.strerror or fault}; {advice}") from fault
    finally:
        remove(part)


_ROOM_BYTES = 4096
"""Bytes that a disk still takes after a file that is whole: a block of common file systems."""


def check_room(path: Path) -> None:
    """Make sure that the disk of a file still takes bytes: libraries may have hidden that it did not.

    Raises:
        OSError: it does not: the disk is full, or the user's quota.
    """
    probe = path.with_name(f".{path.name}.probe")
    try:
        probe.write_bytes(bytes(_ROOM_BYTES))
    finally:
        remove(probe)


def part_path(path: Path) -> Path:
    """Name of a file or folder while it is written."""
    return path.with_name(f".{path.name}.part")


def remove(path: Path) -> None:
    """Remove a file or folder, if it is there."""
    if path.is_dir():
        shutil.rmtree(path)
    elif path.parent.is_dir():
        path.unlink(missing_ok=True)


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
        found = claimed_by(path)
        return "an unknown process" if found is None else f"process {found[2]} on host {found[0]}"
    mine = (platform.node(), _boot(), str(os.getpid()))
    while True:
        try:
            path.symlink_to(" ".join(mine))
            return None
        except FileExistsError:
            found = claimed_by(path)
        except OSError:
            return None
        if found is not None:
            host, boot, pid = found
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


RECORDING_SUFFIX = ".recording"
"""Added to the name of an episode until it is closed."""


def recording_path(path: Path) -> Path:
    """Where the episode `path` stands while it is being recorded."""
    return path.with_name(path.name + RECORDING_SUFFIX)


def check_episode_output(path: Path, *, overwrite: bool = False) -> Path:
    """Path of an episode, if it may be recorded there; an unfinished recording is never overwritten.

    Raises:
        OutputError: the name is taken, is not one of an episode, or a recording waits under it.
    """
    check_output_file(path, suffixes=(EPISODE_SUFFIX,), overwrite=overwrite)
    if recording_path(path).exists():
        raise OutputError(
            f"{recording_path(path)} holds a drive that was not finished, or is still recorded; choose "
            f"another name, or make it whole first: {repair_command(path)}"
        )
    return path


def repair_command(path: Path) -> str:
    """Command that makes a whole episode of the recording of `path`."""
    return f"carlaloc info --repair {recording_path(path)}"


_SPARE_BYTES = 32 << 20
"""Room for HDF5's tables and begun chunks [bytes]."""


def check_space(folder: Path, size_bytes: int) -> None:
    """Make sure that a disk takes a chunk: HDF5 crashes when one is full while it closes a file.

    Raises:
        OSError: there is too little room.
    """
    if shutil.disk_usage(folder).free < 2 * size_bytes + _SPARE_BYTES:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
