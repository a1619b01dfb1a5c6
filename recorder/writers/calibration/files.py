"""All calibration files of a rig in one folder, each loadable by its program as it is."""

from __future__ import annotations

from pathlib import Path

from carlaloc_env.core.files.output_paths import path_below
from recorder.writers.base import write_text
from recorder.writers.calibration.basalt import basalt_fits, basalt_json
from recorder.writers.calibration.fast_lio import fast_lio_yaml
from recorder.writers.calibration.kalibr import camchain_yaml, imu_yaml
from recorder.writers.calibration.launch import (
    A_LOAM_BEAMS,
    a_loam_launch,
    fast_lio_launch,
    lego_loam_launch,
    open_vins_launch,
    s_msckf_launch,
    vins_launch,
)
from recorder.writers.calibration.lego_loam import lego_loam_notes
from recorder.writers.calibration.lidar_odometry import kiss_icp_yaml, rko_lio_yaml
from recorder.writers.calibration.lio_sam import lio_sam_yaml
from recorder.writers.calibration.open_vins import open_vins_texts
from recorder.writers.calibration.orbslam3 import orbslam3_yaml
from recorder.writers.calibration.s_msckf import s_msckf_yaml
from recorder.writers.calibration.vins_fusion import vins_camera_yaml, vins_yaml
from recorder.writers.can_bus import dbc
from recorder.writers.rig_calibration import BASE_FRAME, RigCalibration
from recorder.writers.topics import TopicProfile, profile_by_name
from recorder.writers.yaml_text import nested

EXTRINSICS = "extrinsics.yaml"
"""File of the mounts of all sensors."""


def write_calibration(folder: str | Path, rig: RigCalibration, *, profile: str = "standard") -> list[Path]:
    """Write every file that the rig's sensors allow.

    ``extrinsics.yaml`` always. An IMU, with cameras: Kalibr's files and, where it has a model for their
    lenses, Basalt's. Two cameras: ORB-SLAM3's and VINS-Fusion's, with an IMU as well their inertial ones,
    OpenVINS's and S-MSCKF's. A LiDAR: KISS-ICP's and, of 16, 32 or 64 beams, A-LOAM's; with an IMU
    FAST-LIO2's, LIO-SAM's, RKO-LIO's and LeGO-LOAM's with notes. A CAN bus: ``can.dbc``. Systems of ROS 1 get
    launch files.

    Args:
        folder: Where the files go.
        rig: The sensors.
        profile: Name of the topic profile that the bags are written with.

    Returns:
        The files.

    Raises:
        WriterError: a file exists or cannot be written.
    """
    texts = calibration_texts(rig, profile_by_name(profile))
    return [write_text(path_below(folder, name), text) for name, text in texts.items()]


def calibration_texts(rig: RigCalibration, topics: TopicProfile) -> dict[str, str]:
    """Text of every file by its name."""
    texts = {EXTRINSICS: extrinsics_yaml(rig)}
    stereo = len(rig.cameras) >= 2
    if rig.imu is not None:
        texts["kalibr/imu.yaml"] = imu_yaml(rig.imu, topics)
    if rig.imu is not None and rig.cameras:
        texts["kalibr/camchain-imucam.yaml"] = camchain_yaml(rig, topics)
    if stereo:
        texts["orbslam3_stereo.yaml"] = orbslam3_yaml(rig, inertial=False)
        texts["vins_fusion/stereo.yaml"] = vins_yaml(rig, topics, inertial=False)
        texts["vins_fusion/stereo.launch"] = vins_launch("stereo.yaml")
        for k, camera in enumerate(rig.cameras[:2]):
            texts[f"vins_fusion/cam{k}.yaml"] = vins_camera_yaml(camera)
    if stereo and rig.imu is not None:
        texts["orbslam3_stereo_inertial.yaml"] = orbslam3_yaml(rig, inertial=True)
        texts["vins_fusion/stereo_inertial.yaml"] = vins_yaml(rig, topics, inertial=True)
        texts["s_msckf/camchain-imucam.yaml"] = s_msckf_yaml(rig)
        texts |= {f"open_vins/{name}": text for name, text in open_vins_texts(rig, topics).items()}
        texts["vins_fusion/stereo_inertial.launch"] = vins_launch("stereo_inertial.yaml")
        texts["s_msckf/s_msckf.launch"] = s_msckf_launch(rig, topics)
        texts["open_vins/open_vins.launch"] = open_vins_launch()
    if rig.imu is not None and rig.cameras and basalt_fits(rig):
        texts["basalt.json"] = basalt_json(rig)
    if rig.lidar is not None:
        texts["kiss_icp.yaml"] = kiss_icp_yaml(rig.lidar)
        if rig.lidar.rings in A_LOAM_BEAMS:
            texts["a_loam.launch"] = a_loam_launch(rig.lidar, topics)
    if rig.lidar is not None and rig.imu is not None:
        texts["fast_lio.yaml"] = fast_lio_yaml(rig, topics)
        texts["fast_lio.launch"] = fast_lio_launch()
        texts["lio_sam.yaml"] = lio_sam_yaml(rig, topics)
        texts["rko_lio.yaml"] = rko_lio_yaml(rig)
        texts["lego_loam.launch"] = lego_loam_launch(rig.lidar, topics)
        texts["lego_loam.md"] = lego_loam_notes(rig.lidar)
    if "can" in rig.frames:
        texts["can.dbc"] = dbc()
    return texts


def extrinsics_yaml(rig: RigCalibration) -> str:
    """Pose of every frame in `base_link`, and in the IMU frame where there is one."""
    lines = [
        "# T_a_b maps coordinates of frame b to frame a. base_link: x forward, y left, z up,",
        "# on the ground below the rear axle. Cameras: x right, y down, z forward. Metres.",
        f"base_frame: {BASE_FRAME}",
        "frames:",
    ]
    for frame, T_base_frame in rig.frames.items():
        lines += [f"  {frame}:", f"    T_{BASE_FRAME}_{frame}:", nested(T_base_frame, indent=6)]
        if rig.imu is not None:
            lines += [f"    T_{rig.imu.name}_{frame}:", nested(rig.T(rig.imu.name, frame), indent=6)]
    return "\n".join(lines) + "\n"
