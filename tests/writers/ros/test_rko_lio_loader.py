"""Bags of both kinds by RKO-LIO's own loader: samples, times and extrinsics are those written."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared_fixtures.readings.bag_samples import drive, rig, write_all

from carlaloc_env.samples import Imu, PointCloud
from recorder.writers.base import DEFAULT_EPOCH_NS
from recorder.writers.ros.rosbag1 import Ros1Encoder, Rosbag1Writer
from recorder.writers.ros.rosbag2 import Ros2Encoder, Rosbag2Writer

rosbag = pytest.importorskip("rko_lio.dataloaders.rosbag", reason="RKO-LIO reads bags")


@pytest.fixture(params=["rosbag1", "rosbag2"])
def loader(request: pytest.FixtureRequest, tmp_path: Path) -> Any:
    """RKO-LIO over a bag of everything that a drive has."""
    from rko_lio.config import TimestampConfig

    streams = {sample.sensor for sample in drive()}
    if request.param == "rosbag1":
        writer: Any = Rosbag1Writer(tmp_path / "bags" / "drive.bag", Ros1Encoder(rig(), streams=streams))
    else:
        writer = Rosbag2Writer(tmp_path / "bags", Ros2Encoder(rig(), streams=streams))
    write_all(writer, drive())
    return rosbag.RosbagDataLoader(tmp_path / "bags", None, None, None, None, None, TimestampConfig())


def test_samples_are_those_that_were_written(loader: Any) -> None:
    imu = [sample for sample in drive() if isinstance(sample, Imu)]
    clouds = [sample for sample in drive() if isinstance(sample, PointCloud) and sample.sensor == "lidar"]
    read = list(loader)
    assert len(loader) == len(read) == len(imu) + len(clouds)
    found = [data for kind, data in read if kind == "imu"]
    assert [data["time"] for data in found] == [DEFAULT_EPOCH_NS + sample.stamp_ns for sample in imu]
    for data, sample in zip(found, imu, strict=True):
        assert np.array_equal(data["acceleration"], sample.specific_force_mps2)
        assert np.array_equal(data["angular_velocity"], sample.angular_rate_radps)


def test_points_have_their_own_times(loader: Any) -> None:
    labelled = [s for s in drive() if isinstance(s, PointCloud) and s.sensor == "lidar_semantic"]
    found = [data for kind, data in loader if kind == "lidar"]
    assert len(found) == len(labelled) > 2
    for data, sample in zip(found, labelled, strict=True):
        begin = DEFAULT_EPOCH_NS + sample.stamp_ns
        assert np.allclose(np.asarray(data["scan"]), sample.points_xyz_m, atol=1e-6)
        # Times lie in the cloud in single precision: 49 ms to 4 ns; RKO-LIO counts on in doubles of seconds.
        assert np.abs(data["timestamps"] - begin - sample.offset_ns.astype(np.int64)).max() < 500
        assert abs(data["start_time_ns"] - begin) < 500


def test_extrinsics_come_from_the_bag(loader: Any) -> None:
    T_lidar_imu, T_lidar_lidar = loader.extrinsics
    calibration = rig()
    assert calibration.imu is not None
    T_base_lidar = calibration.lidar.T_base_lidar  # type: ignore[union-attr]
    assert np.allclose(T_lidar_imu, np.linalg.inv(T_base_lidar) @ calibration.imu.T_base_imu, atol=1e-9)
    assert np.allclose(T_lidar_lidar, np.eye(4))
