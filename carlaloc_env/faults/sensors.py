"""Faults of cameras, LiDARs, GNSS receivers, IMUs and wheel encoders.

Faults of cameras: dirt and drops on one lens, wrong exposure, a wrong written lens.

Faults of LiDARs: dead and biased beams, lost points, other LiDARs' pulses, dirt on the window.

Faults of GNSS receivers: times without a fix, and jumps of the position.

Faults of IMUs: saturation and steps of the bias; missing samples are faults of time.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.faults.fields import Draws, MountedFaults, TimingFaults, fault, setting
from carlaloc_env.samples import GnssFix, Image, Imu, PointCloud, Sample, WheelTicks
from carlaloc_env.sensors.base import SensorConfig
from carlaloc_env.weather.parameters import WeatherParameters

DIRT_CELLS = (9, 16)
"""Rows and columns of the noise whose hills are blots of dirt."""
DIRT_RGB = (52.0, 46.0, 38.0)
"""Colour of dirt, sRGB."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraFaults(MountedFaults):
    """Faults of a camera. Those of the data change colour pictures alone; labels and depth are truth."""

    exposure_stops: float = fault(
        "stops", "light is multiplied by 2 to this power, before it is cut at white", worst=4.0,
        source="IEC 61966-2-1 (sRGB)",
    )  # fmt: skip
    dirt_share: float = fault(
        "1", "share of the picture behind blots of dirt, which stay where they are", worst=0.8, low=0.0,
        high=1.0,
    )  # fmt: skip
    drops_percent: float = fault(
        "%", "drops on the lens, as rain of so many per cent of 50 mm/h leaves them", worst=100.0, low=0.0,
        high=100.0,
    )  # fmt: skip
    calib_focal_share: float = fault(
        "1", "written focal lengths are larger by this share", worst=0.1, low=-0.9
    )
    calib_centre_px: float = fault("px", "added to the written principal point, to the right", worst=20.0)

    def apply(self, sample: Sample, draws: Draws) -> Sample:
        """A colour picture of a faulty camera."""
        if not isinstance(sample, Image):
            return sample
        rgb, stamp_ns = sample.rgb, sample.stamp_ns
        if self.drops_percent:
            # Imported here: rigs know faults, and commands refuse mistakes before OpenCV is there.
            from carlaloc_env.sensors.imaging.lens_drops import with_lens_drops

            rain, camera = WeatherParameters(precipitation=self.drops_percent), f"{draws.target}/fault"
            rgb = with_lens_drops(rgb, rain, stamp_ns=stamp_ns, seed=draws.seed, camera=camera)
        if self.dirt_share:
            share = dirt(rgb.shape[:2], self.dirt_share, draws)[..., None]
            mixed = rgb * (1.0 - share) + np.array(DIRT_RGB, np.float32) * share + np.float32(0.5)
            rgb = mixed.astype(np.uint8)
        if self.exposure_stops:
            rgb = exposed(self.exposure_stops)[rgb]
        return replace(sample, rgb=rgb)

    def believed(self, config: SensorConfig) -> SensorConfig:
        """The configuration with the written mount and lens."""
        moved: Any = MountedFaults.believed(self, config)
        lens, scale = moved.pinhole, 1.0 + self.calib_focal_share
        focal: Any = {"fx_px": lens.fx_px * scale, "fy_px": lens.fy_px * scale}
        written: SensorConfig = replace(
            moved, pinhole=replace(lens, **focal, cx_px=lens.cx_px + self.calib_centre_px)
        )
        return written


def exposed(stops: float) -> NDArray[np.uint8]:
    """Values that all 256 sRGB values get under another exposure, shape (256,)."""
    code = np.arange(256) / 255.0
    light = np.where(code <= 0.04045, code / 12.92, elementary.power((code + 0.055) / 1.055, 2.4))
    light = np.minimum(light * float(elementary.power(2.0, stops)), 1.0)
    low = 12.92 * light
    code = np.where(
        light <= 0.0031308, low, 1.055 * elementary.power(np.maximum(light, 0.0031308), 1.0 / 2.4) - 0.055
    )
    return np.asarray(255.0 * code + 0.5, np.uint8)


def dirt(shape: tuple[int, ...], share: float, draws: Draws) -> NDArray[np.float32]:
    """How far dirt hides each pixel, 0–1, shape (H, W); `share` of them are more than half hidden."""
    import cv2

    height, width = shape
    noise = draws.at("dirt").random(DIRT_CELLS).astype(np.float32)
    hills = cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC)
    level = np.quantile(hills, 1.0 - share)
    return np.asarray(np.clip(0.5 + 12.0 * (hills - level), 0.0, 1.0), np.float32)


_ROBO3D = "Kong et al. (Robo3D), ICCV 2023"
GHOST_MIN_M = 1.0
"""Least range of a pulse of another LiDAR [m]."""
_BEAMS_MAX = 1024


@dataclass(frozen=True, slots=True, kw_only=True)
class LidarFaults(MountedFaults):
    """Faults of a LiDAR; plain and labelled clouds have the same."""

    dead_beam_share: float = fault(
        "1", "probability that a beam is dead, drawn once for each", worst=1.0, low=0.0, high=1.0,
        source=_ROBO3D,
    )  # fmt: skip
    beam_bias_m: float = fault(
        "m", "standard deviation of a constant error of range, drawn once for each beam", worst=0.3, low=0.0
    )
    range_bias_m: float = fault("m", "added to every range", worst=0.5)
    point_drop_share: float = fault(
        "1", "share of the points that is lost, each by itself", worst=0.99, low=0.0, high=1.0
    )
    crosstalk_share: float = fault(
        "1", "share of the points that another LiDAR's pulse replaces, evenly between 1 m and the true range",
        worst=0.9, low=0.0, high=1.0, source=_ROBO3D,
    )  # fmt: skip
    blocked_deg: float = fault(
        "deg", "width of a sector without points, dirt on the window at a drawn azimuth", worst=350.0,
        low=0.0, high=360.0,
    )  # fmt: skip

    def apply(self, sample: Sample, draws: Draws) -> Sample:
        """A cloud of a faulty LiDAR."""
        if not isinstance(sample, PointCloud):
            return sample
        cloud, xyz, tag = sample, sample.points_xyz_m, sample.tag

        def uniform(what: str, index: int = 0) -> Array:
            key = int(draws.at(f"{what}{index}", cloud.stamp_ns).integers(2**63))
            return ray_uniform(key, cloud.ring, cloud.offset_ns)

        kept = np.ones(len(xyz), bool)
        if self.dead_beam_share:
            kept &= draws.at("dead").random(_BEAMS_MAX)[cloud.ring] >= self.dead_beam_share
        if self.point_drop_share:
            kept &= uniform("point") >= self.point_drop_share
        if self.blocked_deg:
            kept &= ~_is_blocked(cloud, math.radians(self.blocked_deg), draws)
        bias_m = np.full(len(xyz), self.range_bias_m)
        if self.beam_bias_m:
            bias_m += self.beam_bias_m * draws.at("beam").standard_normal(_BEAMS_MAX)[cloud.ring]
        if bias_m.any():
            xyz = _at_range(xyz, _range_m(xyz) + bias_m)
        if self.crosstalk_share:
            ghost = uniform("crosstalk") < self.crosstalk_share
            beyond_m = np.maximum(_range_m(xyz), GHOST_MIN_M) - GHOST_MIN_M
            ghosts = _at_range(xyz, GHOST_MIN_M + uniform("crosstalk", 1) * beyond_m)
            xyz = np.where(ghost[:, None], ghosts, xyz)
            tag = None if tag is None else np.where(ghost, np.uint8(0), tag)
        arrays = ("intensity", "ring", "offset_ns", "instance", "cos_incidence")
        some = {name: value[kept] for name in arrays if (value := getattr(cloud, name)) is not None}
        return replace(cloud, points_xyz_m=xyz[kept], tag=None if tag is None else tag[kept], **some)


def ray_uniform(key: int, ring: NDArray[np.uint16], offset_ns: NDArray[np.uint32]) -> Array:
    """A number in [0, 1) for every ray, by splitmix64 of its beam and time, shape (N,).

    Which other rays have a return does not matter to it (Steele et al., OOPSLA 2014).
    """
    z = (offset_ns.astype(np.uint64) << np.uint64(16)) + ring.astype(np.uint64)
    z = (z + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(key)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        z = (z ^ (z >> np.uint64(shift))) * np.uint64(factor)
    z ^= z >> np.uint64(31)
    share: Array = (z >> np.uint64(11)).astype(np.float64) * 2.0**-53
    return share


def _range_m(xyz: NDArray[np.float32]) -> Array:
    x, y, z = xyz.T.astype(np.float64)
    range_m: Array = np.sqrt(x * x + y * y + z * z)
    return range_m


def _at_range(xyz: NDArray[np.float32], range_m: Array) -> NDArray[np.float32]:
    """Points on the same rays at other ranges, never behind the sensor."""
    scale: Array = np.maximum(range_m, 0.0) / np.maximum(_range_m(xyz), 1e-9)
    moved: NDArray[np.float32] = (xyz * scale[:, None]).astype(np.float32)
    return moved


def _is_blocked(cloud: PointCloud, width_rad: float, draws: Draws) -> NDArray[np.bool_]:
    middle = 2.0 * math.pi * draws.at("dirt").random()
    x, y = cloud.points_xyz_m[:, 0].astype(np.float64), cloud.points_xyz_m[:, 1].astype(np.float64)
    away = (elementary.arctan2(y, x) - middle + math.pi) % (2.0 * math.pi) - math.pi
    blocked: NDArray[np.bool_] = np.abs(away) < 0.5 * width_rad
    return blocked


@dataclass(frozen=True, slots=True, kw_only=True)
class GnssFaults(MountedFaults):
    """Faults of a GNSS receiver."""

    outage_share: float = fault(
        "1", "share of the time without a fix, in bursts; samples come, without a place", worst=0.95, low=0.0,
        high=0.99,
    )  # fmt: skip
    outage_length: float = setting("fixes", "mean length of an outage", default=25.0, low=1.0)
    jump_m: float = fault(
        "m", "length of a level jump, its direction drawn for each jump", worst=100.0, low=0.0
    )
    jump_share: float = setting("1", "share of the time that is displaced by jumps", default=0.2, low=0.0)
    jump_length: float = setting("fixes", "mean length of a jump", default=25.0, low=1.0)

    def apply(self, sample: Sample, draws: Draws) -> Sample:
        """A fix of a faulty receiver, which does not notice jumps: its covariance stays."""
        if not isinstance(sample, GnssFix):
            return sample
        fix, stamp_ns = sample, sample.stamp_ns
        if draws.is_in_burst("outage", stamp_ns, self.outage_share, self.outage_length):
            return replace(
                fix, latitude_deg=math.nan, longitude_deg=math.nan, altitude_m=math.nan, has_fix=False,
                solution="none", satellites=0,
            )  # fmt: skip
        begin_ns = None
        if self.jump_m and fix.has_fix:
            begin_ns = draws.burst_begin_ns("jump", stamp_ns, min(self.jump_share, 0.99), self.jump_length)
        if begin_ns is None:
            return fix
        direction = 2.0 * math.pi * draws.at("direction", begin_ns).random()
        here = GeoReference(
            latitude_deg=fix.latitude_deg, longitude_deg=fix.longitude_deg, height_m=fix.altitude_m
        )
        east, north = self.jump_m * elementary.cos(direction), self.jump_m * elementary.sin(direction)
        latitude, longitude, _ = here.enu_to_geodetic([east, north, 0.0]).tolist()
        return replace(fix, latitude_deg=latitude, longitude_deg=longitude)


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuFaults(TimingFaults):
    """Faults of an IMU; its place is the origin of all calibration, and never wrong."""

    accel_limit_mps2: float = fault(
        "m/s²", "each axis of the specific force is cut at ± this", neutral=math.inf, worst=9.9, low=0.0
    )
    gyro_limit_radps: float = fault(
        "rad/s", "each axis of the body rate is cut at ± this", neutral=math.inf, worst=0.05, low=0.0
    )
    accel_bias_mps2: float = fault(
        "m/s²", "added to each axis from `begin_s` on, a step of the bias", worst=1.0
    )
    gyro_bias_radps: float = fault("rad/s", "added to each axis from `begin_s` on", worst=0.1)

    def apply(self, sample: Sample, draws: Draws) -> Sample:
        """A measurement of a faulty IMU: the biased value, cut at the limits."""
        if not isinstance(sample, Imu):
            return sample
        force = sample.specific_force_mps2 + self.accel_bias_mps2
        rate = sample.angular_rate_radps + self.gyro_bias_radps
        return replace(
            sample,
            specific_force_mps2=np.clip(force, -self.accel_limit_mps2, self.accel_limit_mps2),
            angular_rate_radps=np.clip(rate, -self.gyro_limit_radps, self.gyro_limit_radps),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class WheelFaults(TimingFaults):
    """Faults of wheel encoders."""

    slip: float = fault(
        "1", "rear wheels turn by this share more than their way, (ωr − v) / v", worst=0.5, low=-1.0,
        source="SAE J670",
    )  # fmt: skip

    def apply(self, sample: Sample, draws: Draws) -> Sample:
        """Counters of wheels that slip since the drive began, whole ticks rounded down."""
        if not isinstance(sample, WheelTicks):
            return sample
        gain = np.array([1.0, 1.0, 1.0 + self.slip, 1.0 + self.slip])
        ticks = np.floor(sample.ticks * gain).astype(np.int64)
        return replace(sample, ticks=ticks, rate_radps=sample.rate_radps * gain)
