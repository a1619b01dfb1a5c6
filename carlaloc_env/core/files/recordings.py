"""Recordings of drives: the name of an episode until it is closed, and the room on disk that it needs."""

import errno
import os
import shutil
from pathlib import Path

from carlaloc_env.core.errors import OutputError
from carlaloc_env.core.files.output_paths import EPISODE_SUFFIX, check_output_file

RECORDING_SUFFIX = ".recording"
"""Added to the name of an episode until it is closed."""
_SPARE_BYTES = 32 << 20
"""Room for HDF5's tables and begun chunks [bytes]."""


def recording_path(path: Path) -> Path:
    """Path of the episode `path` while it is being recorded."""
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


def check_space(folder: Path, size_bytes: int) -> None:
    """Make sure that a disk takes a chunk: HDF5 crashes when one is full while it closes a file.

    Raises:
        OSError: there is too little room.
    """
    if shutil.disk_usage(folder).free < 2 * size_bytes + _SPARE_BYTES:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
