"""Settings for systems that take little: KISS-ICP, RKO-LIO."""

from __future__ import annotations

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import WriterError
from carlaloc_env.core.geometry import transforms
from recorder.writers.rig_calibration import LidarCalibration, RigCalibration
from recorder.writers.yaml_text import real


def kiss_icp_yaml(lidar: LidarCalibration) -> str:
    """Configuration for ``kiss_icp_pipeline --config``."""
    return (
        "data:\n"
        f"  max_range: {real(lidar.range_max_m)}\n"
        f"  min_range: {real(max(2.0, lidar.range_min_m))}\n"
        "  deskew: true\n"
        "mapping:\n"
        f"  voxel_size: {real(lidar.range_max_m / 100.0)}\n"
        "  max_points_per_voxel: 20\n"
    )


def rko_lio_yaml(rig: RigCalibration) -> str:
    """Configuration for ``rko_lio -c``; its base is the LiDAR, whose pose it then tells.

    Raises:
        WriterError: the rig lacks the LiDAR or the IMU.
    """
    if rig.lidar is None or rig.imu is None:
        raise WriterError("RKO-LIO needs a LiDAR and an IMU; add them to the rig")
    lidar, imu = rig.lidar, rig.imu
    return (
        "# qx, qy, qz, qw, x, y, z\n"
        f"extrinsic_imu2base_quat_xyzw_xyz: {_quat_xyz(rig.T(lidar.name, imu.name))}\n"
        "extrinsic_lidar2base_quat_xyzw_xyz: [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]\n"
        f"min_range: {real(max(2.0, lidar.range_min_m))}\n"
        f"max_range: {real(lidar.range_max_m)}\n"
        "deskew: true\n"
        "initialization_phase: true\n"
    )


def _quat_xyz(T: Array) -> str:
    values = [*transforms.matrix_to_quat(T[:3, :3]).tolist(), *T[:3, 3].tolist()]
    return "[" + ", ".join(real(value) for value in values) + "]"
