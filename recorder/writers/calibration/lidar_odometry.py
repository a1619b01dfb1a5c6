"""Settings for systems that take little: KISS-ICP, RKO-LIO, A-LOAM."""

from __future__ import annotations

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import WriterError
from carlaloc_env.core.geometry import transforms
from carlaloc_env.samples import PointCloud
from recorder.writers.rig_calibration import LidarCalibration, RigCalibration
from recorder.writers.topics import TopicProfile
from recorder.writers.yaml_text import real

A_LOAM_BEAMS = (16, 32, 64)
"""Numbers of beams that A-LOAM takes."""


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


def a_loam_launch(lidar: LidarCalibration, topics: TopicProfile) -> str:
    """Launch file for A-LOAM; `lego_loam.md` has its traps with this LiDAR.

    Raises:
        WriterError: the LiDAR has a number of beams that A-LOAM does not take.
    """
    if lidar.rings not in A_LOAM_BEAMS:
        raise WriterError(f"A-LOAM takes {A_LOAM_BEAMS} beams, not {lidar.rings}; change the LiDAR")
    return f"""\
<launch>
    <!-- Set scanPeriod in src/scanRegistration.cpp to {1 / lidar.rate_hz:.3f}. -->
    <param name="scan_line" type="int" value="{lidar.rings}" />
    <param name="mapping_skip_frame" type="int" value="1" />
    <param name="minimum_range" type="double" value="{max(2.0, lidar.range_min_m):g}" />
    <param name="mapping_line_resolution" type="double" value="0.2" />
    <param name="mapping_plane_resolution" type="double" value="0.4" />

    <node pkg="aloam_velodyne" type="ascanRegistration" name="ascanRegistration" output="screen">
        <remap from="/velodyne_points" to="{topics.topic(PointCloud, lidar.name)}" />
    </node>
    <node pkg="aloam_velodyne" type="alaserOdometry" name="alaserOdometry" output="screen" />
    <node pkg="aloam_velodyne" type="alaserMapping" name="alaserMapping" output="screen" />
</launch>
"""


def _quat_xyz(T: Array) -> str:
    values = [*transforms.matrix_to_quat(T[:3, :3]).tolist(), *T[:3, 3].tolist()]
    return "[" + ", ".join(real(value) for value in values) + "]"
