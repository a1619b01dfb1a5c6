"""Kalibr's camera chain and IMU files, read by S-MSCKF, OpenVINS and others as well."""

from __future__ import annotations

from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import Image, Imu
from recorder.writers.rig_calibration import ImuCalibration, RigCalibration
from recorder.writers.topics import TopicProfile
from recorder.writers.yaml_text import nested, real


def camchain_yaml(rig: RigCalibration, topics: TopicProfile) -> str:
    """Camera chain: ``T_cam_imu`` maps the IMU frame to the camera, ``T_cn_cnm1`` the camera before.

    Raises:
        WriterError: the rig has no IMU.
    """
    if rig.imu is None:
        raise WriterError("Kalibr's camera chain needs an IMU; add one to the rig")
    lines: list[str] = []
    for k, camera in enumerate(rig.cameras):
        p = camera.pinhole
        lines += [f"cam{k}:", "  T_cam_imu:", nested(rig.T(camera.frame, rig.imu.name), indent=2)]
        if k > 0:
            lines += ["  T_cn_cnm1:", nested(rig.T(camera.frame, rig.cameras[k - 1].frame), indent=2)]
        overlaps = [other for other in range(len(rig.cameras)) if other != k]
        lines += [
            f"  cam_overlaps: [{', '.join(str(other) for other in overlaps)}]",
            "  camera_model: pinhole",
            f"  distortion_coeffs: [{', '.join(real(c) for c in camera.lens.coefficients)}]",
            # Without distortion every reader knows radtan.
            f"  distortion_model: {'radtan' if camera.lens.is_plain else camera.lens.model}",
            f"  intrinsics: [{real(p.fx_px)}, {real(p.fy_px)}, {real(p.cx_px)}, {real(p.cy_px)}]",
            f"  resolution: [{p.width_px}, {p.height_px}]",
            f"  rostopic: {topics.topic(Image, camera.stream)}",
            "  timeshift_cam_imu: 0.0",
        ]
    return "\n".join(lines) + "\n"


def imu_yaml(imu: ImuCalibration, topics: TopicProfile) -> str:
    """Noise of the IMU as continuous-time densities, the true values of the simulation."""
    return (
        "# m/s^2/sqrt(Hz), m/s^3/sqrt(Hz), rad/s/sqrt(Hz), rad/s^2/sqrt(Hz), Hz\n"
        f"accelerometer_noise_density: {real(imu.accelerometer_noise_density)}\n"
        f"accelerometer_random_walk: {real(imu.accelerometer_random_walk)}\n"
        f"gyroscope_noise_density: {real(imu.gyroscope_noise_density)}\n"
        f"gyroscope_random_walk: {real(imu.gyroscope_random_walk)}\n"
        f"rostopic: {topics.topic(Imu, imu.name)}\n"
        f"update_rate: {real(imu.rate_hz)}\n"
    )
