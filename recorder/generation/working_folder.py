"""The working folder of a replay: all is written there and takes its final names when all is whole.

``OUT/.carlaloc-partial/run-…/`` holds ``run.json``, which says what run it is, and the town's folder as
it will stand in the dataset. The run holds a lock on ``run.json`` that the kernel lets go of however the
process ends, so that the next run knows what was left behind: what was not whole it removes, and what
was whole it gives the names that the killed run had no time to give.
"""

from __future__ import annotations

import json
import logging
import os
import secrets
from collections.abc import Mapping
from pathlib import Path
from shutil import rmtree
from types import TracebackType
from typing import IO, Any

from carlaloc_env.core.errors import WriterError
from carlaloc_env.core.names import check_name
from carlaloc_env.core.output_paths import path_below
from recorder.generation.dataset_manifest import is_begun, write_record

try:
    import fcntl
except ImportError:  # Windows, where an open file cannot be removed, so that it needs no lock.
    fcntl = None  # type: ignore[assignment]

FOLDER = ".carlaloc-partial"
"""Folder of unfinished work in the folder of a dataset."""
MARKER = "run.json"
"""File that says what run it is; locked while the run lives."""
WHOLE = "whole\n"
"""Second line of that file, once all that the run writes is whole."""
SHARED = ("calibration", "ground_truth")
"""What all sequences of a town share."""

_log = logging.getLogger(__name__)


class WorkingFolder:
    """Where one run writes; as a context manager it leaves nothing behind when the run fails.

    Args:
        out: Folder of the dataset.
        town: Name of the town's folder in it.
        origin: What all sequences of the dataset share.
        request: What identifies the run among others into the same folder.
    """

    def __init__(self, out: Path, town: str, origin: Mapping[str, Any], request: str) -> None:
        self._out, self._town = out, town
        self._marks = {"request": request, "town": town, "origin": dict(origin)}
        self._whole = False
        self._made = [folder for folder in (out, *out.parents) if not folder.exists()]
        self._lock: IO[str] | None = None
        self.path = out / FOLDER / f"run-{secrets.token_hex(6)}"
        """Folder of the run."""

    @property
    def town_dir(self) -> Path:
        """Folder of the town while it is being written."""
        return self.path / self._town

    def __enter__(self) -> WorkingFolder:
        # Under its final name the folder is locked from the beginning.
        new = self.path.with_name(f"new-{self.path.name}")
        try:
            new.mkdir(parents=True)
            self._lock = (new / MARKER).open("x", encoding="utf-8")
            _take(self._lock)
            self._lock.write(json.dumps(self._marks) + "\n")
            self._lock.flush()
            new.rename(self.path)
        except OSError as error:
            self._leave()
            raise WriterError(f"cannot write {self._out}: {error.strerror}; choose another --out") from error
        return self

    def publish(self) -> None:
        """Give everything its final name; from here on a killed run is finished by the next one.

        Raises:
            WriterError: a name was taken meanwhile, or the disk is full.
        """
        for part in self.town_dir.glob("*"):
            final = self._out / self._town / part.name
            if part.name not in SHARED and final.exists():
                raise WriterError(f"{final} exists; choose another --out or delete it first")
        assert self._lock is not None
        # In place, since a new file would not be locked.
        self._lock.write(WHOLE)
        self._lock.flush()
        os.fsync(self._lock.fileno())
        self._whole = True
        _give_names(self._out, self.path, self._marks)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._leave()

    def _leave(self) -> None:
        if self._lock is not None:
            self._lock.close()
        if not self._whole:
            rmtree(self.path, ignore_errors=True)
            rmtree(self.path.with_name(f"new-{self.path.name}"), ignore_errors=True)
        for folder in (self.path.parent, *self._made):
            _remove_if_empty(folder)


def settle_killed_runs(out: Path) -> list[str]:
    """Remove what killed runs left unfinished, and give its names to what they left whole.

    Returns:
        The requests of the runs that are finished by this.

    Raises:
        WriterError: what was whole cannot be given its names.
    """
    finished = []
    for run in sorted((out / FOLDER).glob("*run-*")):
        path_below(out, run.relative_to(out))
        try:
            marker = (run / MARKER).open("r+", encoding="utf-8")
        except OSError:
            marker = None
        if marker is None or not _take(marker):
            continue
        with marker:
            marks = _read_whole(marker)
            if marks is not None:
                _give_names(out, run, marks)
                finished.append(str(marks["request"]))
                _log.warning("finished what a replay that was killed had written whole in %s", out)
            else:
                _log.warning("removed what a replay that was killed left unfinished in %s", run)
        rmtree(run, ignore_errors=True)
    _remove_if_empty(out / FOLDER)
    return finished


def _give_names(out: Path, run: Path, marks: Mapping[str, Any]) -> None:
    """Move what is whole to where it belongs, and list it; may be done again after having been cut off."""
    town = check_name("town", str(marks["town"]))
    begun = is_begun(out, marks["origin"])
    try:
        (out / town).mkdir(parents=True, exist_ok=True)
        for part in sorted((run / town).glob("*")):
            # What has a whole folder of the dataset already is not written over.
            if (part.name in SHARED and begun) or (out / town / part.name).exists():
                rmtree(part)
            else:
                part.rename(out / town / part.name)
    except OSError as error:
        raise WriterError(f"cannot give {error.filename} its final name: {error.strerror}") from error
    write_record(out, dict(marks["origin"]))
    rmtree(run, ignore_errors=True)


def _read_whole(marker: IO[str]) -> dict[str, Any] | None:
    """What a run said of itself, if all that it wrote is whole."""
    first, _, rest = marker.read().partition("\n")
    if rest != WHOLE:
        return None
    marks: dict[str, Any] = json.loads(first)
    return marks


def _take(marker: IO[str]) -> bool:
    """Whether nobody else holds the file; it is held by us then, until it is closed."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(marker, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _remove_if_empty(folder: Path) -> None:
    try:
        folder.rmdir()
    except OSError:
        return
