"""Settings for FAST-LIO2."""

from __future__ import annotations

from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import Imu, PointCloud
from recorder.writers.rig_calibration import RigCalibration
from recorder.writers.topics import TopicProfile
from recorder.writers.yaml_text import real, rows


def fast_lio_yaml(rig: RigCalibration, topics: TopicProfile) -> str:
    """Settings for the rig's LiDAR and IMU; the extrinsics are the LiDAR's pose in the IMU frame.

    Raises:
        WriterError: the rig lacks the LiDAR or the IMU.
    """
    if rig.lidar is None or rig.imu is None:
        raise WriterError("FAST-LIO2 needs a LiDAR and an IMU; add them to the rig")
    lidar, imu = rig.lidar, rig.imu
    T_imu_lidar = rig.T(imu.name, lidar.name)
    return f"""\
common:
    lid_topic: "{topics.topic(PointCloud, lidar.name)}"
    imu_topic: "{topics.topic(Imu, imu.name)}"
    time_sync_en: false
    time_offset_lidar_to_imu: 0.0

preprocess:
    lidar_type: 2          # Velodyne: fields x y z intensity ring time
    scan_line: {lidar.rings}
    scan_rate: {round(lidar.rate_hz)}
    timestamp_unit: 0      # the field time is in seconds after the header's stamp
    blind: {real(max(2.0, lidar.range_min_m))}

mapping:
    # Wider than the simulated noise, as the program's own settings are; kalibr/imu.yaml has the true values.
    acc_cov: 0.1
    gyr_cov: 0.1
    b_acc_cov: 0.0001
    b_gyr_cov: 0.0001
    fov_degree: 360.0
    det_range: {real(lidar.range_max_m)}
    extrinsic_est_en: false
    # The LiDAR in the IMU frame.
    extrinsic_T: {rows([T_imu_lidar[:3, 3]])}
    extrinsic_R: {rows(T_imu_lidar[:3, :3], indent=18)}

publish:
    path_en: true
    scan_publish_en: true
    dense_publish_en: true
    scan_bodyframe_pub_en: true

pcd_save:
    pcd_save_en: false
    interval: -1
"""
