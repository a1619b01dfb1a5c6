"""Rigs by name. Distances along the car are the CARLA-Loc paper's, counted from its IMU.

The paper does not print heights. Here the IMU lies in the cabin 1.5 m ahead of the rear axle; the
cameras stand above the windscreen so that the bonnet shows at the bottom of the picture, and the
LiDAR stands 0.4 m above the roof, whose shadow hides the ground near the car.

A common industrial colour camera by its data sheet: Balluff BVS CA-SF2-0016Z with Sony's IMX273.

The sheet (Technical Documentation BVS CA-SF, "mvBlueFOX3-2016", assets.balluff.com) gives, measured
after EMVA 1288: global shutter, pixels of 3.45 µm, 12 bits, SNR_max 40.2 dB, dynamic range 71.4 dB.
"""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

from carlaloc_env.core.camera_model import Lens, Pinhole
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.camera_config import CameraConfig, ImagerConfig, ShutterConfig
from carlaloc_env.sensors.gnss import GnssConfig
from carlaloc_env.sensors.imu import ImuConfig
from carlaloc_env.sensors.ranging_config import LidarConfig, RadarConfig
from carlaloc_env.sensors.vehicle import SpeedConfig, WheelsConfig

SNR_MAX_DB, DYNAMIC_RANGE_DB, ADC_BITS, PIXEL_UM = 40.2, 71.4, 12, 3.45
"""Figures of the data sheet."""


def saturation_capacity_e() -> float:
    """Electrons at saturation [e⁻]; only shot noise counts there: SNR_max = √N (EMVA 1288 release 3.1)."""
    return float(10.0 ** (SNR_MAX_DB / 10.0))


def temporal_dark_noise_e() -> float:
    """Noise of reading [e⁻].

    The dynamic range is the saturation capacity over the sensitivity threshold, which is
    √(σ_d² + σ_q²/K² + ¼) + ½ electrons (EMVA 1288 release 3.1) with σ_q² = 1/12 of converting.
    """
    full_e = saturation_capacity_e()
    threshold_e = full_e / 10.0 ** (DYNAMIC_RANGE_DB / 20.0)
    electrons_per_number = full_e / (2**ADC_BITS - 1)
    return math.sqrt((threshold_e - 0.5) ** 2 - 0.25 - electrons_per_number**2 / 12.0)


def industrial_imager() -> ImagerConfig:
    """Its imager; unevenness of pixels, which the sheet leaves out, is that of its kind (1 e⁻, 0.5 %)."""
    return ImagerConfig(
        full_well_e=round(saturation_capacity_e()),
        read_noise_e=round(temporal_dark_noise_e(), 2),
        adc_bits=ADC_BITS,
        bayer=True,
        # Of seven pictures of nuScenes and three of KITTI by day the mean is 0.18 to 0.23, tone curve undone.
        target=0.20,
        # The pixel's area (√1/12), and a lens at half of its contrast at 0.5 cycles/px (0.37).
        lens_blur_px=0.47,
        # The same lens and quantum efficiency over larger pixels than the default's 3 µm.
        electrons_per_cd_m2_s=round(ImagerConfig().electrons_per_cd_m2_s * (PIXEL_UM / 3.0) ** 2),
    )


def industrial_shutter() -> ShutterConfig:
    """A global shutter; light is gathered while it is open."""
    return ShutterConfig(motion_blur=True, readout_ms=0.0)


def wide_angle_lens() -> Lens:
    """Distortion of a wide-angle lens on such cameras: that of EuRoC's left camera (sensor.yaml of cam0)."""
    return Lens(model="radtan", coefficients=(-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05))


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


def state_rig() -> SensorRig:
    """IMU, GNSS and speed: about a hundred steps per second."""
    return SensorRig(name="state", sensors=(_imu("flu"), _gnss(), SpeedConfig()))


def dsec_rig() -> SensorRig:
    """A pair of event cameras of the DSEC data set's size and baseline, a LiDAR and an IMU."""
    cameras = tuple(
        CameraConfig(
            name=name,
            mount=Mount(position_m=(IMU_X_M + 0.3, side * 0.3, CAMERA_Z_M), axes="optical"),
            pinhole=Pinhole.from_fov(640, 480, 60.0),
            outputs=("rgb", "depth", "events"),
        )
        for name, side in (("left", 1.0), ("right", -1.0))
    )
    return SensorRig(name="dsec", sensors=(_imu("flu"), *cameras, _hdl32e(), _gnss(), SpeedConfig()))


RIGS = {
    "paper": paper_rig,
    "flu": flu_rig,
    "real": real_rig,
    "minimal": minimal_rig,
    "lidar": lidar_rig,
    "state": state_rig,
    "dsec": dsec_rig,
}
"""Makers of the named rigs."""
RIG_USES = {
    "paper": "to compare with the paper's results",
    "flu": "most SLAM systems: axes and LiDAR that they know",
    "real": "SLAM as on a real car: noise, blur, lens, lost echoes",
    "minimal": "a first look",
    "lidar": "LiDAR SLAM and small files, without OpenGL",
    "state": "agents and drives without cameras and LiDAR",
    "dsec": "event cameras",
}
"""The use of each named rig."""
RIG_RIDES = {"real": "real"}
"""Rides (`physics.params.RIDES`) with which drives are recorded for datasets of a rig."""


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


def _cameras() -> tuple[CameraConfig, CameraConfig]:
    left, right = (
        CameraConfig(
            name=name,
            mount=_mount(0.3, CAMERA_Z_M, "optical", left_m=y),
            outputs=("rgb", "depth", "semantic", "events"),
        )
        for name, y in (("left", 0.2), ("right", -0.2))
    )
    return left, right
