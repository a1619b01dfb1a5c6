"""Settings for OpenVINS: its estimator, the IMU and the cameras, each in a file of its own."""

from __future__ import annotations

import numpy as np

from carlaloc_env.core.errors import WriterError
from carlaloc_env.core.physical_constants import GRAVITY_MPS2
from carlaloc_env.samples import Image, Imu
from recorder.writers.rig_calibration import RigCalibration
from recorder.writers.topics import TopicProfile
from recorder.writers.yaml_text import nested, real


def open_vins_texts(rig: RigCalibration, topics: TopicProfile) -> dict[str, str]:
    """``estimator_config.yaml`` and the two files that it names, by name.

    Raises:
        WriterError: the rig has no stereo pair or no IMU.
    """
    if rig.imu is None or len(rig.cameras) < 2:
        raise WriterError("OpenVINS's stereo settings need two cameras and an IMU; add them to the rig")
    return {
        "estimator_config.yaml": _ESTIMATOR,
        "kalibr_imu_chain.yaml": _imu(rig, topics),
        "kalibr_imucam_chain.yaml": _cameras(rig, topics),
    }


_ESTIMATOR = f"""\
%YAML:1.0

verbosity: "INFO"
use_fej: true
integration: "rk4"
use_stereo: true
max_cameras: 2

# All of it is exact.
calib_cam_extrinsics: false
calib_cam_intrinsics: false
calib_cam_timeoffset: false
calib_imu_intrinsics: false
calib_imu_g_sensitivity: false

max_clones: 11
max_slam: 50
max_slam_in_update: 25
max_msckf_in_update: 40
dt_slam_delay: 1

gravity_mag: {GRAVITY_MPS2}

feat_rep_msckf: "GLOBAL_3D"
feat_rep_slam: "ANCHORED_MSCKF_INVERSE_DEPTH"
feat_rep_aruco: "ANCHORED_MSCKF_INVERSE_DEPTH"

# A car stands at traffic lights.
try_zupt: true
zupt_chi2_multipler: 0
zupt_max_velocity: 0.1
zupt_noise_multiplier: 10
zupt_max_disparity: 0.5
zupt_only_at_beginning: false

init_window_time: 2.0
init_imu_thresh: 0.5
init_max_disparity: 10.0
init_max_features: 75
init_dyn_use: false
# Not used, but it ends where one is missing.
init_dyn_mle_opt_calib: false
init_dyn_mle_max_iter: 50
init_dyn_mle_max_time: 0.05
init_dyn_mle_max_threads: 6
init_dyn_num_pose: 6
init_dyn_min_deg: 10.0
init_dyn_inflation_ori: 10
init_dyn_inflation_vel: 100
init_dyn_inflation_bg: 10
init_dyn_inflation_ba: 100
init_dyn_min_rec_cond: 1e-12
init_dyn_bias_g: [0.0, 0.0, 0.0]
init_dyn_bias_a: [0.0, 0.0, 0.0]
num_aruco: 1024
downsize_aruco: true
up_aruco_sigma_px: 1
up_aruco_chi2_multipler: 1
record_timing_filepath: "/tmp/traj_timing.txt"

record_timing_information: false
save_total_state: false

use_klt: true
num_pts: 200
fast_threshold: 20
grid_x: 5
grid_y: 5
min_px_dist: 10
knn_ratio: 0.70
track_frequency: 21.0
downsample_cameras: false
num_opencv_threads: 4
histogram_method: "HISTOGRAM"
use_aruco: false

up_msckf_sigma_px: 1
up_msckf_chi2_multipler: 1
up_slam_sigma_px: 1
up_slam_chi2_multipler: 1
use_mask: false

relative_config_imu: "kalibr_imu_chain.yaml"
relative_config_imucam: "kalibr_imucam_chain.yaml"
"""


def _imu(rig: RigCalibration, topics: TopicProfile) -> str:
    imu = rig.imu
    assert imu is not None
    same, none = np.eye(3), np.zeros((3, 3))
    text = "%YAML:1.0\n\nimu0:\n" + f"  T_i_b:\n{nested(np.eye(4), indent=4)}\n"
    for name, value in (
        ("accelerometer_noise_density", imu.accelerometer_noise_density),
        ("accelerometer_random_walk", imu.accelerometer_random_walk),
        ("gyroscope_noise_density", imu.gyroscope_noise_density),
        ("gyroscope_random_walk", imu.gyroscope_random_walk),
    ):
        text += f"  {name}: {real(value)}\n"
    text += f"  rostopic: {topics.topic(Imu, imu.name)}\n  time_offset: 0.0\n"
    text += f'  update_rate: {real(imu.rate_hz)}\n  model: "kalibr"\n'
    matrices = (("Tw", same), ("R_IMUtoGYRO", same), ("Ta", same), ("R_IMUtoACC", same), ("Tg", none))
    return text + "".join(f"  {name}:\n{nested(matrix, indent=4)}\n" for name, matrix in matrices)


def _cameras(rig: RigCalibration, topics: TopicProfile) -> str:
    assert rig.imu is not None
    text = "%YAML:1.0\n\n"
    for k, camera in enumerate(rig.cameras[:2]):
        p = camera.pinhole
        fisheye = camera.lens.model == "equidistant"
        text += (
            f"cam{k}:\n  T_imu_cam: # maps the camera to the IMU\n"
            f"{nested(rig.T(rig.imu.name, camera.frame), indent=4)}\n"
            f"  cam_overlaps: [{1 - k}]\n  camera_model: pinhole\n"
            f"  distortion_coeffs: [{', '.join(real(c) for c in camera.lens.coefficients)}]\n"
            f"  distortion_model: {'equidistant' if fisheye else 'radtan'}\n"
            f"  intrinsics: [{real(p.fx_px)}, {real(p.fy_px)}, {real(p.cx_px)}, {real(p.cy_px)}]\n"
            f"  resolution: [{p.width_px}, {p.height_px}]\n"
            f"  rostopic: {topics.topic(Image, camera.stream)}\n  timeshift_cam_imu: 0.0\n"
        )
    return text
