"""Calibration for S-MSCKF: Kalibr's camera chain with matrices in one bracket, and the IMU as body."""

from __future__ import annotations

import numpy as np

from carlaloc_env.core.errors import WriterError
from recorder.writers.rig_calibration import RigCalibration
from recorder.writers.yaml_text import real, rows


def s_msckf_yaml(rig: RigCalibration) -> str:
    """The file that its launch files take as ``calibration_file``.

    Raises:
        WriterError: the rig has no stereo pair or no IMU.
    """
    if rig.imu is None or len(rig.cameras) < 2:
        raise WriterError("S-MSCKF needs two cameras and an IMU; add them to the rig")
    text = ""
    for k, camera in enumerate(rig.cameras[:2]):
        p = camera.pinhole
        text += f"cam{k}:\n  T_cam_imu:\n    {rows(rig.T(camera.frame, rig.imu.name), indent=4)}\n"
        if k:
            text += f"  T_cn_cnm1:\n    {rows(rig.T(camera.frame, rig.cameras[0].frame), indent=4)}\n"
        text += (
            "  camera_model: pinhole\n"
            f"  distortion_coeffs: [{', '.join(real(c) for c in camera.lens.coefficients)}]\n"
            f"  distortion_model: {'equidistant' if camera.lens.model == 'equidistant' else 'radtan'}\n"
            f"  intrinsics: [{real(p.fx_px)}, {real(p.fy_px)}, {real(p.cx_px)}, {real(p.cy_px)}]\n"
            f"  resolution: [{p.width_px}, {p.height_px}]\n"
            "  timeshift_cam_imu: 0.0\n"
        )
    return text + f"T_imu_body:\n  {rows(np.eye(4), indent=2)}\n"
