"""Settings for VINS-Fusion: stereo, with and without IMU."""

from __future__ import annotations

from carlaloc_env.core.errors import WriterError
from carlaloc_env.core.physical_constants import GRAVITY_MPS2
from carlaloc_env.samples import Image, Imu
from recorder.writers.rig_calibration import CameraCalibration, RigCalibration
from recorder.writers.topics import TopicProfile
from recorder.writers.yaml_text import opencv_matrix, real

_TRACKING = """\
# 0: trust body_T_cam0 and body_T_cam1, which are exact
estimate_extrinsic: 0
multiple_thread: 1

max_cnt: 200
min_dist: 30
freq: 20
F_threshold: 1.0
show_track: 0
flow_back: 1

max_solver_time: 0.04
max_num_iterations: 8
keyframe_parallax: 10.0
"""


def vins_yaml(rig: RigCalibration, topics: TopicProfile, *, inertial: bool) -> str:
    """Settings for the first two cameras, with ``cam0.yaml`` and ``cam1.yaml`` beside them.

    ``body_T_cam`` maps a camera to the body: the IMU, or the left camera where the rig has none.

    Raises:
        WriterError: the rig has no stereo pair, or no IMU where one is needed.
    """
    if len(rig.cameras) < 2:
        raise WriterError("VINS-Fusion's stereo settings need two cameras; add one to the rig")
    imu = rig.imu
    if inertial and imu is None:
        raise WriterError("VINS-Fusion's inertial settings need an IMU; add one to the rig")
    left, right = rig.cameras[:2]
    body = imu.name if imu is not None else left.frame
    text = f"%YAML:1.0\n---\nimu: {int(inertial)}\nnum_of_cam: 2\n"
    if imu is not None:
        text += f'imu_topic: "{topics.topic(Imu, imu.name)}"\n'
    text += (
        f'image0_topic: "{topics.topic(Image, left.stream)}"\n'
        f'image1_topic: "{topics.topic(Image, right.stream)}"\n'
        'output_path: "/tmp/vins_output/"\n'
        'cam0_calib: "cam0.yaml"\ncam1_calib: "cam1.yaml"\n'
        f"image_width: {left.pinhole.width_px}\nimage_height: {left.pinhole.height_px}\n\n"
    )
    text += opencv_matrix("body_T_cam0", rig.T(body, left.frame))
    text += opencv_matrix("body_T_cam1", rig.T(body, right.frame))
    text += "\n" + _TRACKING
    if inertial and imu is not None:
        text += (
            "\n# Fifty times the simulated white noise: the filter linearises, and tuned for the exact\n"
            "# densities it trusts the IMU too much. The true values stand in kalibr/imu.yaml.\n"
            f"acc_n: {real(50 * imu.accelerometer_noise_density)}\n"
            f"gyr_n: {real(50 * imu.gyroscope_noise_density)}\n"
            f"acc_w: {real(imu.accelerometer_random_walk)}\n"
            f"gyr_w: {real(imu.gyroscope_random_walk)}\n"
            f"g_norm: {GRAVITY_MPS2}\n"
        )
    text += "\nestimate_td: 0\ntd: 0.0\n\nload_previous_pose_graph: 0\n"
    return text + 'pose_graph_save_path: "/tmp/vins_output/pose_graph/"\nsave_image: 0\n'


def vins_camera_yaml(camera: CameraCalibration) -> str:
    """Intrinsics in the form of camodocal, which VINS-Fusion uses."""
    p = camera.pinhole
    fisheye = camera.lens.model == "equidistant"
    a, b, c, d = (real(value) for value in camera.lens.coefficients)
    text = (
        f"%YAML:1.0\n---\nmodel_type: {'KANNALA_BRANDT' if fisheye else 'PINHOLE'}\n"
        f"camera_name: {camera.name}\n"
        f"image_width: {p.width_px}\nimage_height: {p.height_px}\n"
    )
    if fisheye:
        # camodocal counts the coefficients by the power of the angle's polynomial.
        return text + (
            "projection_parameters:\n"
            f"   k2: {a}\n   k3: {b}\n   k4: {c}\n   k5: {d}\n"
            f"   mu: {real(p.fx_px)}\n   mv: {real(p.fy_px)}\n"
            f"   u0: {real(p.cx_px)}\n   v0: {real(p.cy_px)}\n"
        )
    return text + (
        f"distortion_parameters:\n   k1: {a}\n   k2: {b}\n   p1: {c}\n   p2: {d}\n"
        "projection_parameters:\n"
        f"   fx: {real(p.fx_px)}\n   fy: {real(p.fy_px)}\n   cx: {real(p.cx_px)}\n   cy: {real(p.cy_px)}\n"
    )
