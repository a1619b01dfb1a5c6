"""Time left of a dataset: told by unit costs at first, then by what this machine has taken."""

from __future__ import annotations

from pathlib import Path

import pytest

from recorder.factory.plan import DatasetPlan, DrivePlan
from recorder.factory.quantities import duration_text, size_text
from recorder.factory.time_left import DRIVING, REPLAYING, DatasetClock, DatasetProgress


def plan(*, towns: int, driving_s: float, replaying_s: float) -> DatasetPlan:
    drives = tuple(
        DrivePlan(
            town=f"town{k}",
            length_s=100.0,
            recorded_s=100.0,
            is_whole=False,
            driving_s=driving_s,
            replaying_s=replaying_s,
        )
        for k in range(towns)
    )
    return DatasetPlan(
        sequences=towns, driven_s=100.0 * towns, size=0, needed=0, free=0, work_s=0, drives=drives
    )


class Machine:
    """A machine that is some times slower than the one on which unit costs were measured."""

    def __init__(self, slowness: float) -> None:
        self.now_s, self.slowness, self.told = 1000.0, slowness, list[DatasetProgress]()
        of = plan(towns=3, driving_s=40.0, replaying_s=400.0)
        self.clock = DatasetClock(of, 10.0, self.told.append, clock=lambda: self.now_s)

    def work(self, town: str, kind: str, estimate_s: float, folder: Path, *, until: float = 1.0) -> None:
        stage = self.clock.stage(town, kind, folder)
        for percent in range(0, round(100 * until) + 1):
            self.now_s += self.slowness * estimate_s / 100 if percent else 0.0
            stage.update(percent, 100.0)
        if until == 1.0:
            stage.finish()


@pytest.mark.parametrize("slowness", [0.5, 1.0, 5.0])
def test_time_left_is_right_from_the_first_unit_on(slowness: float, tmp_path: Path) -> None:
    machine = Machine(slowness)
    machine.work("town0", DRIVING, 40.0, tmp_path)
    before_replay = len(machine.told)
    machine.work("town0", REPLAYING, 400.0, tmp_path, until=0.5)
    # Before a unit of 10 s is done the estimate holds; the slowness of driving does not count.
    assert machine.told[0].left_s == pytest.approx(3 * 440.0)
    assert machine.told[before_replay].stage_left_s == pytest.approx(400.0)
    assert machine.told[before_replay + 5].rate == pytest.approx(100 / 400 / slowness)
    for percent in range(10, 51):
        progress = machine.told[before_replay + percent]
        left_s = slowness * (400.0 * (1 - percent / 100) + 2 * 440.0)
        assert progress.left_s == pytest.approx(left_s)
        assert progress.share == pytest.approx((40.0 + 4.0 * percent) / 1320.0)


def test_what_an_earlier_run_did_is_not_this_ones_pace(tmp_path: Path) -> None:
    machine = Machine(2.0)
    stage = machine.clock.stage("town0", REPLAYING, tmp_path)
    for done_s in (90.0, 95.0):
        stage.update(done_s, 100.0)
        machine.now_s += 40.0
    assert machine.told[-1].stage_left_s == pytest.approx(20.0), "5 s are no unit: the estimate holds"
    stage.finish()
    machine.work("town1", REPLAYING, 400.0, tmp_path, until=0.0)
    assert machine.told[-1].stage_left_s == pytest.approx(400.0)


def test_the_size_is_that_of_the_folder(tmp_path: Path) -> None:
    machine = Machine(1.0)
    (tmp_path / "Town" / "ClearNoon").mkdir(parents=True)
    (tmp_path / "Town" / "ClearNoon" / "a.bag").write_bytes(bytes(1000))
    (tmp_path / "Town" / "ClearNoon" / "sequence.yaml").write_bytes(bytes(10))
    (tmp_path / "unit.spool").write_bytes(bytes(100))
    stage = machine.clock.stage("town0", REPLAYING, tmp_path)
    stage.update(0.0, 100.0)
    (tmp_path / "unit.spool").write_bytes(bytes(200))
    machine.now_s += 6.0
    stage.update(1.0, 100.0)
    assert [progress.size for progress in machine.told] == [1110, 1210]


def test_quantities_as_people_read_them() -> None:
    assert [duration_text(s) for s in (0.4, 89.4, 90, 3599, 30_000)] == [
        "0 s", "89 s", "2 min", "1 h 0 min", "8 h 20 min",
    ]  # fmt: skip
    assert [size_text(b) for b in (100, 35.4e6, 4.24e9, 310e9, 1.1e12)] == [
        "0 kB", "35 MB", "4.2 GB", "310 GB", "1.1 TB",
    ]  # fmt: skip
