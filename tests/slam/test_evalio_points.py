"""The grid of points that evalio's pipelines get: every point in the cell of its beam and column."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.readings.slam_dataset import COLUMNS, ELEVATIONS_DEG, pose, sweep, write_dataset

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.sensors.imu import ImuConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from recorder.dataset.readings import ImuSample
from recorder.dataset.sequence import SlamSequence
from recorder.slam.runners.evalio_pipelines import lidar_measurement, loam
from recorder.slam.system import FrameClock

types = pytest.importorskip("evalio.types", reason="the points are evalio's")


def test_every_point_has_a_cell_of_its_own(tmp_path: Path) -> None:
    """Times are float32: a point may come a breath too early for its column, and must not hide another."""
    sequence = SlamSequence(write_dataset(tmp_path / "d", sweeps=3) / "Box" / "ClearNoon_dynamic")
    for k, scan in enumerate(sequence.scans()):
        points = lidar_measurement(scan, sequence, types).points
        assert [(p.row, p.col) for p in points] == [
            (r, c) for r in range(len(ELEVATIONS_DEG)) for c in range(COLUMNS)
        ]
        written = sweep(k * 100_000_000).points_xyz_m
        by_row = written.reshape(COLUMNS, len(ELEVATIONS_DEG), 3).transpose(1, 0, 2).reshape(-1, 3)
        assert np.array_equal(np.array([(p.x, p.y, p.z) for p in points]), by_row.astype(float))


def test_a_pattern_without_rows_is_refused(tmp_path: Path) -> None:
    class OfALivox(WithImu):
        lidar = LidarConfig(**LidarConfig.preset_values("mid360"))

    folder = write_dataset(tmp_path / "d", sweeps=2) / "Box" / "ClearNoon_dynamic"
    with pytest.raises(EvaluationError, match="give a spinning LiDAR"):
        loam(OfALivox(folder), FrameClock())


class WithImu(SlamSequence):
    """A sequence with an inertial unit at the LiDAR that says nothing."""

    imu = ImuConfig(name="imu")

    def imu_samples(self) -> Iterator[ImuSample]:
        """None: LOAM does not ask."""
        return iter(())

    def T(self, parent: str, child: str) -> Array:
        """Both are in one place."""
        return np.eye(4)


def test_loam_finds_its_way(tmp_path: Path) -> None:
    """With a quarter of the points hidden it found no features, and stood."""
    folder = write_dataset(tmp_path / "d", sweeps=9) / "Box" / "ClearNoon_dynamic"
    found = loam(WithImu(folder, cloud="seg"), FrameClock())
    estimate = np.array([T_world_imu[:3, 3] for _, T_world_imu in found])
    truth, _ = pose(np.arange(9) * 0.1)
    way_m = np.linalg.norm(truth[-1] - truth[0])
    assert np.linalg.norm(estimate[-1] - estimate[0]) == pytest.approx(way_m, rel=0.1)
