"""The working folder of a replay: units and sequences lie there until all is whole and takes its final names.

``OUT/.carlaloc-partial`` holds ``run.json``, which describes the run; ``units``, the finished units of
workers; and the town's folder as it will stand in the dataset. A run holds a lock on ``run.json`` that the
kernel releases when the process ends, and ``owner``, which names its host and process. The same run resumes
from the remains of a killed or failed run.
"""

from __future__ import annotations

import errno
import json
import logging
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from shutil import copytree, rmtree
from types import TracebackType
from typing import IO, Any

from carlaloc_env.core.errors import WriterError, check_name
from carlaloc_env.core.files.atomic_files import remove
from carlaloc_env.core.files.file_locks import claim, has_name
from carlaloc_env.core.files.output_paths import path_below
from recorder.dataset.layout import CALIBRATION, GROUND_TRUTH, DriveFolder
from recorder.dataset.manifest import has_drive, list_drive

FOLDER = ".carlaloc-partial"
"""Folder of unfinished work in the folder of a dataset."""
MARKER = "run.json"
"""File that describes the run; locked while the run lives."""
OWNER = "owner"
"""Claim of the run that lives (`claim` of `output_paths`)."""
WHOLE = "whole\n"
"""Second line of that file, written when all outputs are complete."""
UNITS = "units"
"""Folder of finished units."""
SHARED = (CALIBRATION, GROUND_TRUTH)
"""Folders that all sequences of a drive share."""

_log = logging.getLogger(__name__)


class WorkingFolder:
    """The folder of a run; as a context manager it keeps only finished units when the run fails.

    Args:
        out: Folder of the dataset.
        town: Name of the drive's folder in it.
        origin: Description that all sequences of the drive share.
        request: Everything that determines the bytes of the run, as plain values by name.
    """

    def __init__(self, out: Path, town: str, origin: Mapping[str, Any], request: Mapping[str, str]) -> None:
        self._out, self._town = out, town
        self._request = dict(request)
        self._marks = {"request": dict(request), "town": town, "origin": dict(origin)}
        self._made = [folder for folder in (out, *out.parents) if not folder.exists()]
        self._lock: IO[str] | None = None
        self._is_whole = False
        self.is_done = False
        """Whether an earlier run has finished the request."""
        self.path = path_below(out, FOLDER)
        """The folder."""

    @property
    def drive(self) -> DriveFolder:
        """Folder of the drive while it is being written."""
        return DriveFolder(self.path / self._town)

    @property
    def units_dir(self) -> Path:
        """Folder of units."""
        return self.path / UNITS

    def __enter__(self) -> WorkingFolder:
        try:
            self._lock = self._locked()
            marker_text = self._lock.read()
            if marker_text:
                self._resume(marker_text)
            else:
                self._lock.write(json.dumps(self._marks) + "\n")
                self._lock.flush()
            self.units_dir.mkdir(exist_ok=True)
        except OSError as error:
            self._leave()
            raise WriterError(f"cannot write {self._out}: {error.strerror}; choose another --out") from error
        except BaseException:
            self._unlock()
            raise
        return self

    def _locked(self) -> IO[str]:
        """Open the marker file, locked for this process."""
        while True:
            self.path.mkdir(parents=True, exist_ok=True)
            marker = (self.path / MARKER).open("a+", encoding="utf-8")
            if (other := claim(self.path / OWNER, marker)) is not None:
                marker.close()
                raise WriterError(busy(self._out, other))
            # A run that has just ended may have removed the file meanwhile.
            if has_name(marker, self.path / MARKER):
                marker.seek(0)
                return marker
            marker.close()

    def _resume(self, marker_text: str) -> None:
        """Resume the work of an earlier run, or refuse it."""
        first, _, rest = marker_text.partition("\n")
        try:
            marks: dict[str, Any] = json.loads(first)
            theirs: dict[str, str] = marks["request"]
        except (ValueError, KeyError, TypeError):
            # Killed within its first millisecond.
            self._restart()
            return
        if rest == WHOLE:
            _give_names(self._out, self.path, marks)
            _log.warning("kept the whole files of a killed replay in %s", self._out)
            self.is_done = theirs == self._request
            if not self.is_done:
                self._restart()
            return
        other = [name for name, value in self._request.items() if theirs.get(name) != value]
        if other:
            raise WriterError(
                f"{self._out} holds an unfinished run with another {' and '.join(other[:2])}; finish it with "
                f"the command that began it, choose another --out, or delete {self.path}"
            )
        self._sweep()
        (self.units_dir / "stop").unlink(missing_ok=True)

    def _restart(self) -> None:
        assert self._lock is not None
        for old in self.path.iterdir():
            if old.is_dir():
                rmtree(old)
        self._lock.seek(0)
        self._lock.truncate()
        self._lock.write(json.dumps(self._marks) + "\n")
        self._lock.flush()

    def publish(self) -> None:
        """Move everything to its final name; from here on the next run finishes a killed one.

        Raises:
            WriterError: a name was taken meanwhile, or the disk is full.
        """
        for part in self.drive.path.glob("*"):
            final = self._out / self._town / part.name
            if part.name not in SHARED and final.exists():
                raise WriterError(f"{final} exists; choose another --out or delete it first")
        assert self._lock is not None
        # In place, since a new file would not be locked.
        self._is_whole = True
        self._lock.write(WHOLE)
        self._lock.flush()
        os.fsync(self._lock.fileno())
        _give_names(self._out, self.path, self._marks)
        self.is_done = True

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._leave()

    def kept(self) -> int:
        """Number of finished units and sequences from which another run can resume."""
        units = sum("." not in path.name for path in self.units_dir.glob("*") if path.is_dir())
        return units + sum(path.name not in SHARED for path in self.drive.path.glob("[!.]*"))

    def _sweep(self) -> None:
        """Remove the unfinished work of killed workers."""
        for half in (*self.units_dir.glob("*.part"), *self.drive.path.glob(".*.part")):
            rmtree(half, ignore_errors=True)
        for stale in self.units_dir.glob("*.progress"):
            stale.unlink(missing_ok=True)

    def _leave(self) -> None:
        if self._lock is None:
            for folder in (self.path, *self._made):
                _remove_if_empty(folder)
            return
        # Removed while it is locked, so that no other run takes it up in between.
        if self.is_done or not (self._is_whole or self.kept()):
            rmtree(self.path, ignore_errors=True)
        else:
            self._sweep()
        self._unlock()
        for folder in self._made:
            _remove_if_empty(folder)

    def _unlock(self) -> None:
        if self._lock is not None:
            remove(self.path / OWNER)
            self._lock.close()
            self._lock = None


def busy(out: Path, other: str) -> str:
    """Error of a folder in which another process works."""
    return f"another run is at work in {out}: {other}; wait until it has ended, or choose another --out"


def _give_names(out: Path, run: Path, marks: Mapping[str, Any]) -> None:
    """Move finished folders to their final places, and list them; an interrupted call can be repeated."""
    town = check_name("town", str(marks["town"]))
    begun = has_drive(out, town, marks["origin"])
    try:
        (out / town).mkdir(parents=True, exist_ok=True)
        for part in sorted((run / town).glob("*")):
            # A whole folder of the dataset is not overwritten.
            if (part.name in SHARED and begun) or (out / town / part.name).exists():
                rmtree(part)
            else:
                _move(part, out / town / part.name)
    except OSError as error:
        raise WriterError(f"cannot give {error.filename} its final name: {error.strerror}") from error
    list_drive(out, town, marks["origin"])


def _move(part: Path, final: Path) -> None:
    """Give a finished folder its final name, also on another disk, where the drive may be a link."""
    try:
        part.rename(final)
    except OSError as error:
        if error.errno != errno.EXDEV:
            raise
        half = final.with_name(f".{final.name}.part")
        rmtree(half, ignore_errors=True)
        copytree(part, half).rename(final)
        rmtree(part)


def _remove_if_empty(folder: Path) -> None:
    with suppress(OSError):
        folder.rmdir()
