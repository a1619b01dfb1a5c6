"""Names of an episode: the final one, the one of a recording, and which may be written."""

from __future__ import annotations

from pathlib import Path

from carlaloc_env.core.errors import OutputError
from carlaloc_env.core.files.output_paths import EPISODE_SUFFIX, check_output_file

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
