"""Files and folders that are written whole or not at all: as ``.NAME.part`` first, then renamed.

The next process that writes ``NAME`` removes one left behind. There is no fsync: these files can be made
again after a power cut. Recordings cannot, and spools of units are trusted by later runs: both call fsync
themselves.
"""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from carlaloc_env.core.errors import CarlaLocError, OutputError

_ROOM_BYTES = 4096
"""Bytes that a disk still takes after a file that is whole: a block of common file systems."""


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


def write_whole(
    path: Path, text: str, error: type[CarlaLocError] = OutputError, advice: str = "choose another place"
) -> Path:
    """Write a text file, and return its path; the arguments and errors are those of `atomic_write`."""
    with atomic_write(path, error, advice) as part:
        part.write_text(text, encoding="utf-8")
    return path


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
