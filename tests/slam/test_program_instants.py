"""Instants of the poses of others' programs, as our files state them, by a drive through a room.

The LiDAR has the beams of an HDL-32E, by which A-LOAM knows its rings. What is missing is skipped. Systems
that match points to points (KISS-ICP, KISS-SLAM, RKO-LIO) tell nothing here: rings on the floor hold them.
"""

import numpy as np
import pytest
from shared_fixtures.processes.external_programs import EXTERNAL, missing_program, missing_ros
from shared_fixtures.readings.slam_dataset import describe, list_dataset
from shared_fixtures.worlds.closed_room import EPOCH_S, SWEEP_S, late_s, write_room_bag

from carlaloc_env.core.transforms import matrix_to_quat
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.imu import ImuConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from recorder.dataset.sequence import SlamSequence
from recorder.evaluation.trajectory import Trajectory
from recorder.slam.system import FrameClock
from recorder.slam.system_file import read_system_file
from recorder.writers.calibration.files import write_calibration
from recorder.writers.rig_calibration import RigCalibration

HDL32E_DEG = -92.0 / 3.0 + 4.0 / 3.0 * np.arange(32)


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> SlamSequence:
    root = tmp_path_factory.mktemp("room")
    mount = Mount(position_m=(0.0, 0.0, 1.8))
    lidar = LidarConfig(mount=mount, rate_hz=1.0 / SWEEP_S, elevations_deg=tuple(HDL32E_DEG.tolist()))
    rig = SensorRig(name="room", sensors=(ImuConfig(mount=mount), lidar))
    folder = root / "Room" / "ClearNoon_static"
    folder.mkdir(parents=True)
    write_room_bag(folder / "ClearNoon_static.bag", HDL32E_DEG)
    describe(folder, rig, samples={"lidar": 1, "imu": 1})
    list_dataset(root, rig)
    sequence = SlamSequence(folder)
    write_calibration(sequence.calibration, RigCalibration.from_configs(rig.sensors))
    return sequence


@pytest.mark.parametrize(
    ("file", "program"), [("genz_icp_pipeline.yaml", "genz_icp_pipeline"), ("a_loam.yaml", "aloam_velodyne")]
)
def test_poses_stand_where_the_file_says(file: str, program: str, room: SlamSequence) -> None:
    """At constant speed the LiDAR was in the place of a pose at the stated instant, to a third of a sweep."""
    missing = missing_ros(program) if program == "aloam_velodyne" else missing_program(program)
    if missing:
        pytest.skip(missing)
    found = read_system_file(EXTERNAL / file)
    poses = found.run(room, FrameClock())
    T = np.stack([pose for _, pose in poses])
    stamp_ns = np.array([stamp for stamp, _ in poses]) + round(found.system.instant * SWEEP_S * 1e9)
    estimate = Trajectory(
        stamp_ns=stamp_ns, position_m=T[:, :3, 3], quat_xyzw=matrix_to_quat(T[:, :3, :3]), name=found.title
    )
    assert stamp_ns[0] * 1e-9 > EPOCH_S - 1e-3
    assert abs(late_s(estimate)) < 0.3 * SWEEP_S
