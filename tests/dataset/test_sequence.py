"""Sequences as SLAM systems read them, from a dataset in closed form."""

from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.readings.slam_dataset import CAR_SHARE, COLUMNS, ELEVATIONS_DEG, sweep, write_dataset

from carlaloc_env.core.errors import EvaluationError
from recorder.dataset.sequence import SEGMENTED, SlamSequence
from recorder.writers.base import DEFAULT_EPOCH_NS


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_dataset(tmp_path_factory.mktemp("d"), sweeps=3) / "Box" / "ClearNoon_dynamic"


def test_sweeps_are_those_that_were_written(folder: Path) -> None:
    scans = list(SlamSequence(folder).scans())
    assert len(scans) == 3
    written = sweep(100_000_000)
    assert scans[1].stamp_ns == DEFAULT_EPOCH_NS + 100_000_000
    assert np.array_equal(scans[1].points_xyz_m, written.points_xyz_m.astype(float))
    assert scans[1].ring is not None
    assert np.array_equal(scans[1].ring, written.ring)
    assert np.allclose(scans[1].time_s, written.offset_ns * 1e-9, atol=1e-8)


def test_segmented_sweeps_lack_what_moves_by_itself(folder: Path) -> None:
    raw = next(SlamSequence(folder).scans())
    kept = next(SlamSequence(folder, cloud=SEGMENTED).scans())
    assert raw.tag is not None
    assert len(kept.points_xyz_m) == np.count_nonzero(raw.tag != raw.tag.max())
    share = 1.0 - len(kept.points_xyz_m) / (COLUMNS * len(ELEVATIONS_DEG))
    assert share == pytest.approx(CAR_SHARE, abs=0.02)


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda s: s.imu, "has no imu; replay with a rig"),
        (lambda s: s.stereo, "has 0 cameras; stereo needs two"),
        (lambda s: s.euroc, "has no mav0; replay with --format"),
    ],
)
def test_what_is_missing_is_named(folder: Path, ask: object, message: str) -> None:
    with pytest.raises(EvaluationError, match=message):
        ask(SlamSequence(folder))  # type: ignore[operator]


def test_a_lidar_is_chosen_by_its_name(tmp_path: Path) -> None:
    """Its clouds, its truth and its settings; files of calibration are the first LiDAR's."""
    folder = write_dataset(tmp_path / "d", sweeps=2, second="rear") / "Box" / "ClearNoon_dynamic"
    first, rear = SlamSequence(folder), SlamSequence(folder, lidar="rear")
    assert (first.lidar.name, first.cloud_topic) == ("lidar", "/lidar/points")
    assert (rear.lidar.name, rear.cloud_topic) == ("rear", "/rear/points")
    counts = [len(next(sequence.scans()).points_xyz_m) for sequence in (first, rear)]
    assert counts == [COLUMNS * len(ELEVATIONS_DEG), COLUMNS * len(ELEVATIONS_DEG) // 2]
    assert rear.truth_file("lidar").name == "rear.tum"
    assert first.calibration.name == "calibration"
    with pytest.raises(EvaluationError, match=r"first LiDAR, not 'rear'; run the system over the drive"):
        _ = rear.calibration
    with pytest.raises(EvaluationError, match="did you mean 'rear'"):
        SlamSequence(folder, lidar="reer")


def test_a_sequence_out_of_its_dataset_is_refused(tmp_path: Path) -> None:
    with pytest.raises(EvaluationError, match=r"holds no sequence\.yaml"):
        SlamSequence(tmp_path)
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "sequence.yaml").write_text("name: a\n")
    with pytest.raises(EvaluationError, match="move the whole dataset"):
        SlamSequence(tmp_path / "a")
