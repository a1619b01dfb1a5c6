"""Damaged, hostile and foolish inputs by the thousand: read, or refused with one line, and nothing else."""

import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from bad_input.hunt import Tally, WriteGuard, hunt
from bad_input.targets import Seeds, targets

from carlaloc_env.core.files.array_cache import default_cache_dir
from recorder.drive.record import RecordConfig, record
from recorder.evaluation.trajectory import Trajectory
from recorder.evaluation.trajectory_files import write_tum
from recorder.replaying.replay import ReplayConfig, replay

NAMES = tuple(targets(Seeds(episode=Path(), bag=Path(), tum=Path()), Path()))
FEW, MANY = 80, 11_200
"""Inputs of one kind: in the tests (about 1000 in all) and in the soak (100 000)."""


@pytest.fixture(scope="module")
def seeds(tmp_path_factory: pytest.TempPathFactory) -> Seeds:
    """A drive of half a second, and what a LiDAR saw of it."""
    folder = tmp_path_factory.mktemp("seeds")
    episode = folder / "drive.mcap"
    record(
        RecordConfig(
            map="Town03", out=episode, duration_s=0.5, seed=5, traffic="dynamic,vehicles=5,walkers=3"
        )
    )
    rig = folder / "rig.yaml"
    rig.write_text("name: thin\nsensors:\n- {kind: lidar, name: lidar, columns: 24, outputs: [cloud]}\n")
    replay(
        ReplayConfig(
            episode=episode, out=folder / "data", rig=str(rig), formats=("rosbag1",), preview=False, workers=1
        )
    )
    (bag,) = (folder / "data").rglob("*.bag")
    return Seeds(episode=episode, bag=bag, tum=write_tum(folder / "truth.tum", _bend()))


def _bend() -> Trajectory:
    """Four seconds round a bend of 20 m radius at 5 m/s."""
    angle = np.linspace(0.0, 1.0, 41)
    zero = np.zeros_like(angle)
    return Trajectory(
        stamp_ns=np.arange(41, dtype=np.int64) * 100_000_000 + 1_672_531_200_000_000_000,
        position_m=np.stack([20.0 * np.sin(angle), 20.0 - 20.0 * np.cos(angle), zero], axis=-1),
        quat_xyzw=np.stack([zero, zero, np.sin(angle / 2), np.cos(angle / 2)], axis=-1),
    )


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where hunted commands may write."""
    return tmp_path_factory.mktemp("hunt")


@pytest.fixture(scope="module")
def guard(work: Path, seeds: Seeds) -> Iterator[WriteGuard]:
    # `carlaloc info --repair` writes beside the episode when it is not told where to.
    beside = ("drive_repaired.mcap", ".drive_repaired.mcap.part")
    repaired = [seeds.episode.with_name(name) for name in beside]
    guard = WriteGuard((work, default_cache_dir(), *repaired))
    guard.install()
    yield guard
    guard.active = False


@pytest.fixture(autouse=True)
def _nobody_there(work: Path, guard: WriteGuard, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Commands run in the folder that they may write into, without keyboard or screen."""
    monkeypatch.chdir(work)
    # What is unpacked to be read lies there, too.
    monkeypatch.setattr(tempfile, "tempdir", str(work))
    guard.astray.clear()
    monkeypatch.delenv("DISPLAY", raising=False)
    with Path("/dev/null").open() as silence:
        monkeypatch.setattr(sys, "stdin", silence)
        yield


def _hunted(name: str, count: int, seeds: Seeds, work: Path, guard: WriteGuard) -> Tally:
    before = {path: path.read_bytes() for path in (seeds.episode, seeds.tum)}
    inputs, read = targets(seeds, work)[name]()
    tally = hunt(name, inputs, read, count, guard)
    assert tally.tried >= 0.8 * count
    # A hunt that refuses nothing, or everything, hunts nothing.
    assert 0 < tally.refused < tally.tried
    assert all(path.read_bytes() == data for path, data in before.items())
    return tally


@pytest.mark.parametrize("name", NAMES)
def test_inputs_are_read_or_refused(name: str, seeds: Seeds, work: Path, guard: WriteGuard) -> None:
    _hunted(name, FEW, seeds, work, guard)


@pytest.mark.soak
@pytest.mark.timeout(14400)
@pytest.mark.parametrize("name", NAMES)
def test_a_hundred_thousand_inputs(
    name: str, seeds: Seeds, work: Path, guard: WriteGuard, record_property: Callable[[str, object], None]
) -> None:
    tally = _hunted(name, MANY, seeds, work, guard)
    record_property("what", f"bad input: {name}")
    record_property("inputs", tally.tried)
    record_property("refused", f"{tally.refused / tally.tried:.0%}")
    record_property("slowest", f"{tally.slowest_s:.1f} s")
    record_property("growth", f"{max(tally.growth_mb, 0.0):.0f} MB")
