"""Writes all calibration files of a rig into one folder, each loadable by its program as it is."""

import math
from pathlib import Path
from typing import Any

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import GRAVITY_MPS2
from carlaloc_env.core.errors import WriterError
from carlaloc_env.core.files.output_paths import path_below
from carlaloc_env.samples import GnssFix, Image, Imu, PointCloud
from recorder.writers.base import write_text
from recorder.writers.calibration.basalt import basalt_fits, basalt_json
from recorder.writers.rig_calibration import BASE_FRAME, RigCalibration
from recorder.writers.text_templates import filled
from recorder.writers.topic_profiles import profile_for
from recorder.writers.topics import TopicProfile

EXTRINSICS = "extrinsics.yaml"
"""File of the mounts of all sensors: each in `base_link`, and in the IMU frame where there is one."""
_BASALT = "basalt.json"
_A_LOAM_BEAMS = (16, 32, 64)
"""Numbers of beams that A-LOAM takes."""
_GROUND_BELOW_DEG = -5.0
"""LeGO-LOAM looks for the ground in beams below this elevation [deg]."""


def write_calibration(folder: str | Path, rig: RigCalibration, *, profile: str = "standard") -> list[Path]:
    """Write every file that the rig's sensors allow.

    ``extrinsics.yaml`` always. An IMU, with cameras: Kalibr's files and, where it has a model for their
    lenses, Basalt's. Two cameras in two places: ORB-SLAM3's and VINS-Fusion's, with an IMU as well their
    inertial ones, OpenVINS's and S-MSCKF's. A LiDAR: KISS-ICP's, with an IMU FAST-LIO2's and RKO-LIO's. One
    that spins: A-LOAM's, of 16, 32 or 64 beams; with an IMU LIO-SAM's and, of several beams, LeGO-LOAM's with
    notes. Systems of ROS 1 get launch files.

    Args:
        folder: Where the files go.
        rig: The sensors.
        profile: Name of the topic profile that the bags are written with.

    Returns:
        The files.

    Raises:
        WriterError: a file exists or cannot be written.
    """
    texts = calibration_texts(rig, profile_for(profile, rig.sensors))
    return [write_text(path_below(folder, name), text) for name, text in texts.items()]


def calibration_texts(rig: RigCalibration, topics: TopicProfile) -> dict[str, str]:
    """Text of every file by its name.

    Raises:
        WriterError: only one of the first two cameras has a fisheye lens.
    """
    if len({camera.lens.model == "equidistant" for camera in rig.cameras[:2]}) > 1:
        raise WriterError("ORB-SLAM3 needs the same lens model on both cameras; change one of them")
    values = _values(rig, topics)
    return {
        name: basalt_json(rig) if name == _BASALT else filled(name, **values) for name in _file_names(rig)
    }


def _file_names(rig: RigCalibration) -> list[str]:
    """Names of the files that the rig's sensors allow."""
    imu, lidar, stereo = rig.imu is not None, rig.lidar is not None, _has_stereo(rig)
    # Others compute rings or range pictures of beams that go all round.
    is_spinning = rig.lidar is not None and rig.lidar.is_spinning
    beams_deg = rig.lidar.elevations_deg if rig.lidar is not None and is_spinning else ()
    # It divides by the angle between beams.
    lego = imu and len(set(beams_deg)) > 1
    files = (
        (True, EXTRINSICS),
        (imu, "kalibr/imu.yaml"),
        (imu and rig.cameras, "kalibr/camchain-imucam.yaml"),
        (stereo, "orbslam3_stereo.yaml"),
        (stereo, "vins_fusion/stereo.yaml"),
        (stereo, "vins_fusion/stereo.launch"),
        (stereo, "vins_fusion/cam0.yaml"),
        (stereo, "vins_fusion/cam1.yaml"),
        (stereo and imu, "orbslam3_stereo_inertial.yaml"),
        (stereo and imu, "vins_fusion/stereo_inertial.yaml"),
        (stereo and imu, "s_msckf/camchain-imucam.yaml"),
        (stereo and imu, "open_vins/estimator_config.yaml"),
        (stereo and imu, "open_vins/kalibr_imu_chain.yaml"),
        (stereo and imu, "open_vins/kalibr_imucam_chain.yaml"),
        (stereo and imu, "vins_fusion/stereo_inertial.launch"),
        (stereo and imu, "s_msckf/s_msckf.launch"),
        (stereo and imu, "open_vins/open_vins.launch"),
        (imu and basalt_fits(rig), _BASALT),
        (lidar, "kiss_icp.yaml"),
        (len(beams_deg) in _A_LOAM_BEAMS, "a_loam.launch"),
        (lidar and imu, "fast_lio.yaml"),
        (lidar and imu, "fast_lio.launch"),
        (is_spinning and imu, "lio_sam.yaml"),
        (lidar and imu, "rko_lio.yaml"),
        (lego, "lego_loam.launch"),
        (lego, "lego_loam.md"),
    )
    return [name for fits, name in files if fits]


def _has_stereo(rig: RigCalibration) -> bool:
    """Whether the first two cameras are 1 mm apart or more: systems divide by their distance."""
    frames = [camera.frame for camera in rig.cameras[:2]]
    return len(frames) == 2 and math.hypot(*rig.T(*frames)[:3, 3]) >= 1e-3


def _values(rig: RigCalibration, topics: TopicProfile) -> dict[str, Any]:
    """Values that the templates fill in."""
    imu, lidar = rig.imu, rig.lidar
    values: dict[str, Any] = {
        "cameras": rig.cameras,
        "imu": imu,
        "lidar": lidar,
        "frames": rig.frames,
        "T": rig.T,
        "R": lambda to_frame, from_frame: rig.T(to_frame, from_frame)[:3, :3],
        "t": lambda to_frame, from_frame: rig.T(to_frame, from_frame)[:3, 3],
        "base_frame": BASE_FRAME,
        "inertial": False,
        "gravity_mps2": GRAVITY_MPS2,
        "image_topic": lambda camera: topics.topic(Image, camera.stream),
        "gnss_topic": topics.topic(GnssFix, "gnss"),
    }
    if imu is not None:
        values["imu_topic"] = topics.topic(Imu, imu.name)
    if lidar is not None:
        beams_deg = lidar.elevations_deg
        values |= {
            "points_topic": topics.topic(PointCloud, lidar.name),
            "points_frame": topics.frame(PointCloud, lidar.name, lidar.name),
            # Nearer than the farthest return in any case.
            "near_m": lidar.near_m
            if lidar.range_min_m < lidar.near_m < lidar.range_max_m
            else lidar.range_min_m,
            "beam_spacing_deg": (beams_deg[-1] - beams_deg[0]) / max(lidar.rings - 1, 1),
            "ground_rings": sum(beam_deg < _GROUND_BELOW_DEG for beam_deg in beams_deg),
        }
    if imu is not None and lidar is not None:
        T = rig.T(lidar.name, imu.name)
        values["imu_quat_xyz"] = [*transforms.matrix_to_quat(T[:3, :3]), *T[:3, 3]]
    return values
