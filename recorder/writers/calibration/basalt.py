"""Calibration for Basalt: one JSON file."""

import json
from typing import Any

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import WriterError
from recorder.writers.rig_calibration import CameraCalibration, RigCalibration


def basalt_fits(rig: RigCalibration) -> bool:
    """Whether Basalt has a model for all lenses: pinhole without distortion, or fisheye."""
    models = {camera.lens.is_plain or camera.lens.model == "equidistant" for camera in rig.cameras}
    return models == {True}


def basalt_json(rig: RigCalibration) -> str:
    """The file that `basalt_vio` takes as ``--cam-calib``; noise as continuous-time densities.

    Raises:
        WriterError: the rig has no camera, no IMU, or a lens that Basalt has no model for.
    """
    imu = rig.imu
    if imu is None or not rig.cameras or not basalt_fits(rig):
        raise WriterError("Basalt needs an IMU and cameras without radial distortion; change the rig")
    sizes = [[camera.pinhole.width_px, camera.pinhole.height_px] for camera in rig.cameras]
    value: dict[str, Any] = {
        "T_imu_cam": [_pose(rig.T(imu.name, camera.frame)) for camera in rig.cameras],
        "intrinsics": [_intrinsics(camera) for camera in rig.cameras],
        "resolution": sizes,
        "calib_accel_bias": [0.0] * 9,
        "calib_gyro_bias": [0.0] * 12,
        "imu_update_rate": float(imu.rate_hz),
        "accel_noise_std": [imu.accelerometer_noise_density] * 3,
        "gyro_noise_std": [imu.gyroscope_noise_density] * 3,
        "accel_bias_std": [imu.accelerometer_random_walk] * 3,
        "gyro_bias_std": [imu.gyroscope_random_walk] * 3,
        "cam_time_offset_ns": 0,
        "vignette": [],
    }
    # Basalt looks for value0 alone.
    notes = {"comment": imu.raised} if imu.raised else {}
    return json.dumps({"value0": value, **notes}, indent=2) + "\n"


def _pose(T: Array) -> dict[str, float]:
    quat = transforms.matrix_to_quat(T[:3, :3]).tolist()
    names = ("px", "py", "pz", "qx", "qy", "qz", "qw")
    return dict(zip(names, [*T[:3, 3].tolist(), *quat], strict=True))


def _intrinsics(camera: CameraCalibration) -> dict[str, Any]:
    p = camera.pinhole
    values = {"fx": p.fx_px, "fy": p.fy_px, "cx": p.cx_px, "cy": p.cy_px}
    if camera.lens.is_plain:
        return {"camera_type": "pinhole", "intrinsics": values}
    names = ("k1", "k2", "k3", "k4")
    values |= dict(zip(names, camera.lens.coefficients, strict=True))
    return {"camera_type": "kb4", "intrinsics": values}
