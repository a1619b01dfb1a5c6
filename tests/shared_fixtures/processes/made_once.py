"""Files that take long to make: one process of a run makes them, and all others read them."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from carlaloc_env.core.files.file_locks import locked


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """A folder that is filled once in a run, however many processes test; never write to it.

    Args:
        factory: Folders of this run.
        name: The folder's name, one for each content.
        make: Fills the folder.
    """
    run = factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        run = run.parent  # each worker has its own below that of the run
    folder, whole = run / name, run / f".{name}.whole"
    with locked(run / f".{name}.lock"):
        if not whole.exists():
            shutil.rmtree(folder, ignore_errors=True)  # of a making that failed
            folder.mkdir()
            make(folder)
            whole.touch()
    return folder
