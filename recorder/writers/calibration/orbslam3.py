"""Settings for ORB-SLAM3 (format "1.0"): stereo and stereo-inertial.

ORB-SLAM3 stops at a setting of the wrong type, so reals have a point and integers have none.
"""

from __future__ import annotations

from carlaloc_env.core.errors import WriterError
from recorder.writers.rig_calibration import RigCalibration
from recorder.writers.yaml_text import opencv_matrix, real

_TRACKING = """\
ORBextractor.nFeatures: 1500
ORBextractor.scaleFactor: 1.2
ORBextractor.nLevels: 8
ORBextractor.iniThFAST: 20
ORBextractor.minThFAST: 7

Viewer.KeyFrameSize: 0.05
Viewer.KeyFrameLineWidth: 1.0
Viewer.GraphLineWidth: 0.9
Viewer.PointSize: 2.0
Viewer.CameraSize: 0.08
Viewer.CameraLineWidth: 3.0
Viewer.ViewpointX: 0.0
Viewer.ViewpointY: -10.0
Viewer.ViewpointZ: -0.1
Viewer.ViewpointF: 2000.0
Viewer.imageViewScale: 1.0
"""


def orbslam3_yaml(rig: RigCalibration, *, inertial: bool) -> str:
    """Settings for the first two cameras, the left one first.

    Raises:
        WriterError: the rig has no stereo pair, or no IMU where one is needed.
    """
    if len(rig.cameras) < 2:
        raise WriterError("ORB-SLAM3's stereo settings need two cameras; add one to the rig")
    left, right = rig.cameras[:2]
    text = "%YAML:1.0\n---\n"
    fisheye = left.lens.model == "equidistant"
    if fisheye != (right.lens.model == "equidistant"):
        raise WriterError("ORB-SLAM3 needs the same lens model on both cameras; change one of them")
    text += f'File.version: "1.0"\n\nCamera.type: "{"KannalaBrandt8" if fisheye else "PinHole"}"\n'
    names = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2")
    for k, camera in enumerate((left, right), start=1):
        p = camera.pinhole
        text += (
            f"Camera{k}.fx: {real(p.fx_px)}\nCamera{k}.fy: {real(p.fy_px)}\n"
            f"Camera{k}.cx: {real(p.cx_px)}\nCamera{k}.cy: {real(p.cy_px)}\n"
        )
        coefficients = zip(names, camera.lens.coefficients, strict=True)
        text += "".join(f"Camera{k}.{name}: {real(value)}\n" for name, value in coefficients)
    text += (
        f"Camera.width: {left.pinhole.width_px}\nCamera.height: {left.pinhole.height_px}\n"
        f"Camera.fps: {round(left.rate_hz)}\n"
        "# 1: colours in the order red, green, blue; of no effect on grey pictures\n"
        "Camera.RGB: 1\n\n"
        "# Points nearer than this many baselines count as near.\n"
        "Stereo.ThDepth: 60.0\n"
        "# Maps the right camera to the left one.\n"
    )
    text += opencv_matrix("Stereo.T_c1_c2", rig.T(left.frame, right.frame), dt="f")
    if inertial:
        text += "\n" + _imu(rig)
    return text + "\n" + _TRACKING


def _imu(rig: RigCalibration) -> str:
    imu = rig.imu
    if imu is None:
        raise WriterError("ORB-SLAM3's stereo-inertial settings need an IMU; add one to the rig")
    return (
        "# Maps the left camera to the IMU.\n"
        + opencv_matrix("IMU.T_b_c1", rig.T(imu.name, rig.cameras[0].frame), dt="f")
        + f"IMU.NoiseGyro: {real(imu.gyroscope_noise_density)}\n"
        + f"IMU.NoiseAcc: {real(imu.accelerometer_noise_density)}\n"
        + f"IMU.GyroWalk: {real(imu.gyroscope_random_walk)}\n"
        + f"IMU.AccWalk: {real(imu.accelerometer_random_walk)}\n"
        + f"IMU.Frequency: {real(imu.rate_hz)}\n"
        + "IMU.InsertKFsWhenLost: 0\n"
    )
