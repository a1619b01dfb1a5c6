"""Rigs by name; distances along the car are the CARLA-Loc paper's, counted from its IMU.

The paper does not print heights. Here the IMU lies in the cabin, the cameras stand above the windscreen so
that the bonnet shows in the picture, and the LiDAR stands 0.4 m above the roof.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.rigs.industrial_camera import industrial_imager, industrial_shutter, wide_angle_lens
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.gnss import GnssConfig
from carlaloc_env.sensors.imu import ImuConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.sensors.radar_config import RadarConfig
from carlaloc_env.sensors.vehicle import SpeedConfig, WheelsConfig

IMU_X_M = 1.5
"""The IMU, the paper's origin, ahead of the rear axle [m]."""
IMU_Z_M = 1.2
"""Height of the IMU above the ground [m]."""
CAMERA_Z_M = 1.60
"""Height of the cameras above the ground [m]."""
LIDAR_Z_M = 1.85
"""Height of LiDAR and radars above the ground [m]."""
GNSS_Z_M = 1.5
"""Height of the GNSS antenna above the ground [m]."""
RIG_USES = {
    "paper": "to compare with the paper's results",
    "flu": "most SLAM systems: axes and LiDAR that they know",
    "real": "SLAM as on a real car: noise, blur, lens, lost echoes",
    "minimal": "a first look",
    "lidar": "LiDAR SLAM and small files, without OpenGL",
    "lidars": "LiDARs of five makers beside each other, without OpenGL",
    "state": "agents and drives without cameras and LiDAR",
    "dsec": "event cameras",
}
"""The use of each named rig."""
RIG_RIDES = {"real": "real"}
"""Rides (`physics.params.RIDES`) with which drives are recorded for datasets of a rig."""


def paper_rig() -> SensorRig:
    """The rig of the CARLA-Loc paper, IMU axes up, right, forward."""
    lidar = LidarConfig(mount=_mount(-0.3, LIDAR_Z_M))
    sensors = (_imu("paper_imu"), *_cameras(), lidar, *_radars(), _gnss(), SpeedConfig())
    return SensorRig(name="paper", sensors=sensors)


def flu_rig() -> SensorRig:
    """The same places with the IMU in FLU axes, the angles and timing of an HDL-32E, and wheels."""
    car = (SpeedConfig(), WheelsConfig())
    return SensorRig(name="flu", sensors=(_imu("flu"), *_cameras(), _hdl32e(), *_radars(), _gnss(), *car))


def real_rig() -> SensorRig:
    """The rig `flu` with industrial cameras, the LiDAR's receiver and a second IMU of KITTI's grade."""
    imaging = {"imager": industrial_imager(), "shutter": industrial_shutter(), "lens": wide_angle_lens()}
    changes: dict[str, dict[str, Any]] = {
        "camera": imaging,
        "lidar": LidarConfig.preset_values("hdl32e_road"),
    }
    sensors = tuple(replace(config, **changes.get(config.kind, {})) for config in flu_rig().sensors)
    return SensorRig(name="real", sensors=(*sensors, _kitti_imu()))


def minimal_rig() -> SensorRig:
    """One small colour camera, IMU and speed: for a first look."""
    camera = CameraConfig(
        name="front",
        mount=_mount(0.3, CAMERA_Z_M, "optical"),
        pinhole=Pinhole.from_fov(320, 180, 90.0),
        outputs=("rgb",),
    )
    return SensorRig(name="minimal", sensors=(_imu("flu"), camera, SpeedConfig()))


def lidar_rig() -> SensorRig:
    """HDL-32E, IMU, GNSS and speed; needs no OpenGL."""
    return SensorRig(name="lidar", sensors=(_imu("flu"), _hdl32e(), _gnss(), SpeedConfig()))


def lidars_rig() -> SensorRig:
    """A VLP-16, an OS1-64, a PandarXT-32, a Mid-360 and an Avia on one roof at 10 Hz, IMU, GNSS and speed."""
    places_m = {
        "vlp16": (-0.3, 0.5, LIDAR_Z_M),
        "os1_64": (-0.3, 0.0, LIDAR_Z_M),
        "pandar_xt32": (-0.3, -0.5, LIDAR_Z_M),
        "mid360": (-0.9, 0.0, LIDAR_Z_M),
        "avia": (0.3, 0.0, CAMERA_Z_M),
    }
    lidars = (
        LidarConfig(**{**LidarConfig.preset_values(name), "name": name, "mount": _mount(x, z, left_m=y)})
        for name, (x, y, z) in places_m.items()
    )
    return SensorRig(name="lidars", sensors=(_imu("flu"), *lidars, _gnss(), SpeedConfig()))


def state_rig() -> SensorRig:
    """IMU, GNSS and speed: about a hundred steps per second."""
    return SensorRig(name="state", sensors=(_imu("flu"), _gnss(), SpeedConfig()))


def dsec_rig() -> SensorRig:
    """A pair of event cameras of the DSEC data set's size and baseline, a LiDAR and an IMU."""
    pinhole = Pinhole.from_fov(640, 480, 60.0)
    cameras = _cameras(0.3, outputs=("rgb", "depth", "events"), pinhole=pinhole)
    return SensorRig(name="dsec", sensors=(_imu("flu"), *cameras, _hdl32e(), _gnss(), SpeedConfig()))


RIGS = {
    "paper": paper_rig,
    "flu": flu_rig,
    "real": real_rig,
    "minimal": minimal_rig,
    "lidar": lidar_rig,
    "lidars": lidars_rig,
    "state": state_rig,
    "dsec": dsec_rig,
}
"""Makers of the named rigs."""


def rig_by_name(rig: str | Path) -> SensorRig:
    """Named rig, or the rig of a YAML file.

    Raises:
        ConfigError: neither a known name nor a readable rig file.
    """
    if str(rig) in RIGS:
        return RIGS[str(rig)]()
    path = Path(rig)
    if path.suffix in (".yaml", ".yml"):
        return SensorRig.load(path, RIGS)
    raise ConfigError(unknown_name("rig", str(rig), RIGS) + ", or a .yaml file")


def _mount(forward_m: float, height_m: float, axes: str = "flu", left_m: float = 0.0) -> Mount:
    return Mount(position_m=(round(IMU_X_M + forward_m, 6), left_m, height_m), axes=axes)


def _imu(axes: str) -> ImuConfig:
    return ImuConfig(mount=_mount(0.0, IMU_Z_M, axes))


def _kitti_imu() -> ImuConfig:
    """An OXTS RT3003 at the place of KITTI's (calib_imu_to_velo.txt, and the figure of its car)."""
    place = Mount(position_m=(-0.05, 0.32, 0.93))
    return ImuConfig(name="oxts", mount=place, rate_hz=100.0, **ImuConfig.preset_values("rt3003"))


def _gnss() -> GnssConfig:
    return GnssConfig(mount=_mount(-0.8, GNSS_Z_M))


def _hdl32e() -> LidarConfig:
    return LidarConfig(mount=_mount(-0.3, LIDAR_Z_M), **LidarConfig.preset_values("hdl32e"))


def _radars() -> tuple[RadarConfig, ...]:
    """Three radars that together see all around, at the LiDAR's place."""
    place = _mount(-0.3, LIDAR_Z_M).position_m
    return tuple(
        RadarConfig(name=name, mount=Mount(position_m=place, rpy_deg=(0.0, 0.0, yaw)))
        for name, yaw in (("front", 0.0), ("left", 120.0), ("right", -120.0))
    )


def _cameras(
    half_m: float = 0.2, outputs: tuple[str, ...] = ("rgb", "depth", "semantic", "events"), **more: Any
) -> tuple[CameraConfig, ...]:
    """A pair of cameras, each half the baseline beside the car's middle."""
    return tuple(
        CameraConfig(name=name, mount=_mount(0.3, CAMERA_Z_M, "optical", left_m=y), outputs=outputs, **more)
        for name, y in (("left", half_m), ("right", -half_m))
    )
