"""Files and folders that are written whole or not at all: under a temporary name first, renamed at the end.

The temporary name of ``NAME`` is ``.NAME.part``, in the same folder, since a rename cannot cross disks. A
killed process leaves it behind, and the next one that writes ``NAME`` removes it.

There is no fsync here. A killed process needs none, and after a power cut these files can be made again,
while one fsync a file would slow down a dataset of thousands. Recordings (`recorder.episode`) cannot be made
again, and spools of units (`recorder.replaying`) are trusted by later runs: both call fsync themselves.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from carlaloc_env.core.errors import CarlaLocError, OutputError


@contextmanager
def atomic_write(
    path: Path, error: type[CarlaLocError] = OutputError, advice: str = "choose another place"
) -> Iterator[Path]:
    """Give the temporary path of a file or folder, which takes its name when the block ends.

    An exception in the block removes the unfinished file, and leaves an older one unchanged.

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
        part.replace(path)
    except OSError as fault:
        raise error(f"cannot write {path}: {fault.strerror or fault}; {advice}") from fault
    finally:
        remove(part)


def part_path(path: Path) -> Path:
    """Name of a file or folder while it is written."""
    return path.with_name(f".{path.name}.part")


def remove(path: Path) -> None:
    """Remove a file or folder, if it is there."""
    if path.is_dir():
        shutil.rmtree(path)
    elif path.parent.is_dir():
        path.unlink(missing_ok=True)
