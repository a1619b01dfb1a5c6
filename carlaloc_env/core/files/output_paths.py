"""Checks whether an output may be written: the one rule of all commands and functions."""

import os
from collections.abc import Sequence
from pathlib import Path

from carlaloc_env.core.errors import OutputError

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


def path_below(folder: str | Path, name: str | Path, *, link: bool = False) -> Path:
    """Path of something in a folder; what files of others name is opened through this alone.

    Args:
        folder: The folder.
        name: Name, or path relative to it.
        link: Whether it may be a link to anywhere, as a drive that is kept on another disk.

    Raises:
        OutputError: it lies outside, be it by ``..``, as an absolute path or through a link.
    """
    path = Path(folder) / name
    place = path.parent.resolve() / path.name if link and path.name != ".." else path.resolve()
    if not place.is_relative_to(Path(folder).resolve()) or Path(name) == Path():
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
