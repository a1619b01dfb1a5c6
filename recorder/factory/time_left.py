"""How far a dataset is, and how long the rest takes.

What is left is estimated by unit costs, and the estimate is corrected by what this machine has taken so far:
as soon as the first unit of a kind of work is finished, all that is left of that kind is scaled by it.
"""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from recorder.dataset.layout import SEQUENCE
from recorder.factory.plan import DatasetPlan, DrivePlan

DRIVING, REPLAYING = "driving", "replaying"
"""Kinds of work."""
WINDOW_S = 30.0
"""Time over which the rate is taken [s]."""
_MEASURE_S = 5.0
"""Time between two looks at how large the work in hand is [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DatasetProgress:
    """How far a dataset is, for whoever shows it."""

    town: str
    """Town in hand."""
    number: int
    """Its number, from 1."""
    towns: int
    """Number of towns."""
    activity: str
    """What is being done there: ``driving`` or ``replaying``."""
    done_s: float
    """Seconds of it that are done [s]."""
    total_s: float
    """Seconds of it in all [s]; under several traffic levels each counts."""
    rate: float | None
    """Seconds done in a second; None: not known yet."""
    stage_left_s: float
    """Time that it takes from here [s], roughly."""
    size: int
    """What of this town lies on the disk [bytes]."""
    share: float
    """Share of the whole dataset that is done, 0–1."""
    left_s: float
    """Time that the whole takes from here [s], roughly."""


class DatasetClock:
    """Told how far stages are; tells how far all is.

    Args:
        plan: What is made.
        unit_s: Length of a unit [s]: a measured pace counts when so much is done.
        tell: Told about every progress.
        clock: Tells the time [s].
    """

    def __init__(
        self,
        plan: DatasetPlan,
        unit_s: float,
        tell: Callable[[DatasetProgress], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._plan, self._unit_s, self._tell, self._clock = plan, unit_s, tell, clock
        self._left = {
            (kind, drive.town): _estimate(drive, kind)
            for drive in plan.drives
            if not drive.is_whole
            for kind in (DRIVING, REPLAYING)
        }
        self._whole = sum(_estimate(drive, kind) for drive in plan.drives for kind in (DRIVING, REPLAYING))
        self._spent = {DRIVING: 0.0, REPLAYING: 0.0}
        self._expected = {DRIVING: 0.0, REPLAYING: 0.0}

    def stage(self, town: str, kind: str, folder: Path) -> Stage:
        """Begin a stage.

        Args:
            town: Town in hand.
            kind: `DRIVING` or `REPLAYING`.
            folder: What lies there counts as its size.
        """
        number = [drive.town for drive in self._plan.drives].index(town)
        return Stage(self, self._plan.drives[number], number + 1, kind, folder)

    def finish(self, town: str) -> None:
        """Take note that all of a town is whole."""
        for kind in (DRIVING, REPLAYING):
            self._left.pop((kind, town), None)

    def _pace(self, kind: str, spent_s: float, expected_s: float) -> float:
        """How much longer work of a kind takes here than estimated, by what is done of it."""
        spent_s, expected_s = spent_s + self._spent[kind], expected_s + self._expected[kind]
        return spent_s / expected_s if expected_s > 0 else 1.0


class Stage:
    """One kind of work in one town."""

    def __init__(self, of: DatasetClock, drive: DrivePlan, number: int, kind: str, folder: Path) -> None:
        self._of, self._drive, self._number, self._kind = of, drive, number, kind
        self._folder = _FolderSize(folder)
        self._estimate_s = _estimate(drive, kind)
        self._begin_s = of._clock()
        self._first_s: float | None = None
        self._history: deque[tuple[float, float]] = deque()

    def update(self, done_s: float, total_s: float) -> None:
        """Take note that so many seconds of so many are done; what an earlier run did is not our pace."""
        of, now_s = self._of, self._of._clock()
        if self._first_s is None:
            self._first_s = done_s
        self._history.append((now_s, done_s))
        while now_s - self._history[0][0] > WINDOW_S:
            self._history.popleft()
        total_s = max(total_s, done_s, 1e-9)
        spent_s, share = now_s - self._begin_s, done_s / total_s
        ours = (done_s - self._first_s) / total_s
        is_measured = done_s - self._first_s >= min(of._unit_s, 0.5 * total_s)
        pace = (
            of._pace(self._kind, spent_s, ours * self._estimate_s)
            if is_measured
            else of._pace(self._kind, 0, 0)
        )
        stage_left_s = pace * (1.0 - share) * self._estimate_s
        later = {key: value for key, value in of._left.items() if key != (self._kind, self._drive.town)}
        paces = {kind: pace if kind == self._kind else of._pace(kind, 0, 0) for kind in (DRIVING, REPLAYING)}
        rest = sum(later.values()) + (1.0 - share) * self._estimate_s
        since_s, before_s = self._history[0]
        of._tell(
            DatasetProgress(
                town=self._drive.town,
                number=self._number,
                towns=len(of._plan.drives),
                activity=self._kind,
                done_s=done_s,
                total_s=total_s,
                rate=(done_s - before_s) / (now_s - since_s) if now_s > since_s else None,
                stage_left_s=stage_left_s,
                size=self._folder.bytes_at(now_s),
                share=1.0 - rest / of._whole if of._whole else 1.0,
                left_s=stage_left_s + sum(paces[kind] * value for (kind, _), value in later.items()),
            )
        )

    def finish(self) -> float:
        """Take note that it is done, and return the time that it took [s]."""
        of = self._of
        spent_s = of._clock() - self._begin_s
        # A stage that an earlier run had done in part says little about the others.
        if not self._first_s:
            of._spent[self._kind] += spent_s
            of._expected[self._kind] += self._estimate_s
        of._left.pop((self._kind, self._drive.town), None)
        return spent_s


class _FolderSize:
    """Bytes below a folder, looked at now and then; finished sequences are looked at once."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._looked_s = float("-inf")
        self._size = 0
        self._whole: dict[str, int] = {}

    def bytes_at(self, now_s: float) -> int:
        if now_s - self._looked_s >= _MEASURE_S:
            self._looked_s, self._size = now_s, self._below(str(self._folder))
        return self._size

    def _below(self, folder: str) -> int:
        if folder in self._whole:
            return self._whole[folder]
        size, is_whole = 0, False
        try:
            for entry in os.scandir(folder):
                if entry.is_dir(follow_symlinks=False):
                    size += self._below(entry.path)
                else:
                    size += entry.stat(follow_symlinks=False).st_size
                    is_whole = is_whole or entry.name == SEQUENCE
        except OSError:  # Its owner has just renamed or removed it.
            return size
        if is_whole and not Path(folder).name.startswith("."):
            self._whole[folder] = size
        return size


def _estimate(drive: DrivePlan, kind: str) -> float:
    return drive.driving_s if kind == DRIVING else drive.replaying_s
