"""IMU: specific force and body rate from the true spline, with the errors of a real one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from carlaloc_env.core import clock, transforms
from carlaloc_env.core.array_types import GRAVITY_MPS2, Array
from carlaloc_env.core.clock import TICK_NS
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.samples import Imu, Sample
from carlaloc_env.sensors.base import Sensor, SensorConfig, World
from carlaloc_env.sensors.stochastic_processes import Flicker, RandomWalk, WhiteSequence
from carlaloc_env.timeline.motion import Motion
from carlaloc_env.timeline.timeline import Timeline

ORIENTATIONS = ("none", "truth")
"""What `ImuConfig.orientation` may be."""
LAYOUTS = ("ouster", "ouster_2021", "hesai", "robosense", "livox")
"""Drivers of LiDARs with an IMU inside, whose messages a bag can have."""
_DPS, _G = math.pi / 180.0, GRAVITY_MPS2
"""One degree [rad] and one g [m/s²], the units of data sheets."""
IMU_GRADES: dict[str, dict[str, float]] = {
    "paper": {},
    "adis16448": {
        "accel_noise_density": 2.0e-3,
        "gyro_noise_density": 1.6968e-4,
        "accel_random_walk": 3.0e-3,
        "gyro_random_walk": 1.9393e-5,
        "accel_bias_instability": 0.25e-3 * _G,
        "gyro_bias_instability": 14.5 / 3600 * _DPS,
        "scale_error": 0.002,
        "misalignment_rad": 0.05 * _DPS,
        "accel_range_mps2": 18.0 * _G,
        "gyro_range_radps": 1000.0 * _DPS,
    },
    "consumer": {
        "accel_noise_density": 300e-6 * _G,
        "gyro_noise_density": 0.01 * _DPS,
        "accel_random_walk": 1.0e-3,
        "gyro_random_walk": 4.0e-5,
        "accel_bias_instability": 0.1e-3 * _G,
        "gyro_bias_instability": 20.0 / 3600 * _DPS,
        "accel_turn_on_bias": 30e-3 * _G,
        "gyro_turn_on_bias": 1.0 * _DPS,
        "scale_error": 0.01,
        "misalignment_rad": 0.01,
        "accel_range_mps2": 16.0 * _G,
        "gyro_range_radps": 2000.0 * _DPS,
    },
    "rt3003": {
        "accel_noise_density": 0.005 / 60,
        "gyro_noise_density": 0.2 / 60 * _DPS,
        "accel_random_walk": 1.0e-6,
        "gyro_random_walk": 3.0e-7,
        "accel_bias_instability": 2e-6 * _G,
        "gyro_bias_instability": 2.0 / 3600 * _DPS,
        "accel_turn_on_bias": 0.010,
        "gyro_turn_on_bias": 0.01 * _DPS,
        "scale_error": 0.001,
        "misalignment_rad": 0.05 * _DPS,
        "accel_range_mps2": 100.0,
        "gyro_range_radps": 100.0 * _DPS,
    },
    "tactical": {
        "accel_noise_density": 0.008 / 60,
        "gyro_noise_density": 0.09 / 60 * _DPS,
        "accel_random_walk": 5.0e-6,
        "gyro_random_walk": 3.0e-7,
        "accel_bias_instability": 3.6e-6 * _G,
        "gyro_bias_instability": 1.8 / 3600 * _DPS,
        "accel_turn_on_bias": 1.0e-3 * _G,
        "gyro_turn_on_bias": 0.02 * _DPS,
        "scale_error": 0.0003,
        "misalignment_rad": 0.02 * _DPS,
        "accel_range_mps2": 8.0 * _G,
        "gyro_range_radps": 100.0 * _DPS,
    },
}
"""Grades of IMUs. Densities and walks of the ADIS16448 are EuRoC's (imu0/sensor.yaml), its further
figures those of its data sheet; ``consumer`` follows the MPU-9250's and ``tactical`` the ADIS16490's
data sheet, ``rt3003`` those of OXTS's RT3000 v2 and v3 (KITTI's car had an RT3003). Their walks, and the
scale and mounting errors left after calibration, are ours."""
_FIGURES = (
    "accel_noise_density", "gyro_noise_density", "accel_random_walk", "gyro_random_walk",
    "accel_bias_instability", "gyro_bias_instability", "accel_turn_on_bias", "gyro_turn_on_bias",
    "scale_error", "misalignment_rad", "accel_range_mps2", "gyro_range_radps", "orientation_noise_rad",
)  # fmt: skip
"""Fields of `ImuConfig` that must be finite and not negative."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuConfig(SensorConfig):
    """An IMU in Kalibr's convention: continuous-time densities, not per-sample deviations.

    The defaults are the CARLA-Loc paper's, which are those of EuRoC's ADIS16448 rounded; all other
    errors are off. Grades: ``preset: adis16448``, ``consumer``, ``tactical`` or ``rt3003``.
    """

    kind: ClassVar[str] = "imu"
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = IMU_GRADES

    name: str = "imu"
    """Name of the sensor, its stream and its frame."""
    rate_hz: float = 200.0
    """Measurements per second [Hz]."""
    accel_noise_density: float = 2e-3
    """White noise of the specific force [m/s²/√Hz]."""
    gyro_noise_density: float = 2e-4
    """White noise of the body rate [rad/s/√Hz]."""
    accel_random_walk: float = 3e-3
    """Diffusion of the accelerometer's bias [m/s³/√Hz]."""
    gyro_random_walk: float = 2e-5
    """Diffusion of the gyroscope's bias [rad/s²/√Hz]."""
    accel_bias_instability: float = 0.0
    """B of the accelerometer: its Allan deviation is flat at 0.664·B [m/s²]."""
    gyro_bias_instability: float = 0.0
    """B of the gyroscope [rad/s]."""
    accel_turn_on_bias: float = 0.0
    """Standard deviation of the accelerometer's constant bias [m/s²]."""
    gyro_turn_on_bias: float = 0.0
    """Standard deviation of the gyroscope's constant bias [rad/s]."""
    scale_error: float = 0.0
    """Standard deviation of each axis' scale factor, 0.01 = one per cent."""
    misalignment_rad: float = 0.0
    """Standard deviation of each axis' tilt towards the two others [rad]."""
    accel_range_mps2: float = 0.0
    """Largest specific force that can be read, per axis [m/s²]; 0 = unlimited."""
    gyro_range_radps: float = 0.0
    """Largest body rate that can be read, per axis [rad/s]; 0 = unlimited."""
    orientation: str = "none"
    """Attitude in the sample: ``none``, or ``truth`` with `orientation_noise_rad`; world is ENU."""
    orientation_noise_rad: float = 0.0
    """Standard deviation of that attitude per axis [rad]."""
    layout: str | None = None
    """Driver of the LiDAR that holds it, whose messages bags have beside the project's own; None: none."""

    def __post_init__(self) -> None:
        SensorConfig.__post_init__(self)
        values = tuple(getattr(self, name) for name in _FIGURES)
        if not all(math.isfinite(v) and v >= 0 for v in values):
            raise ConfigError(f"IMU '{self.name}': noise figures {values}; give finite numbers ≥ 0")
        if self.orientation not in ORIENTATIONS:
            raise ConfigError(
                f"IMU '{self.name}': {unknown_name('orientation', self.orientation, ORIENTATIONS)}"
            )
        if self.layout is not None and self.layout not in LAYOUTS:
            raise ConfigError(f"IMU '{self.name}': {unknown_name('layout', self.layout, LAYOUTS)}")

    def build(self, world: World) -> ImuSensor:
        """The IMU in a world."""
        return ImuSensor(self, world.seed)


class ImuSensor(Sensor):
    """Reads the motion of its own mount; at rest its up axis shows +9.81 m/s².

    Reading = clip(M·truth + bias + white noise), with M scale and tilt of the axes.
    """

    config: ImuConfig

    def __init__(self, config: ImuConfig, seed: int) -> None:
        super().__init__(config)
        self._seed = seed
        self._T_base_imu = config.mount.T_base_sensor
        period_s = 1.0 / config.rate_hz
        name = config.name
        self._white_scale = _six(config.accel_noise_density, config.gyro_noise_density) / math.sqrt(period_s)
        self._walk_scale = _six(config.accel_random_walk, config.gyro_random_walk) * math.sqrt(period_s)
        self._flicker_scale = _six(config.accel_bias_instability, config.gyro_bias_instability)
        self._white = WhiteSequence(seed, f"{name}/white", 6)
        self._walk = RandomWalk(seed, f"{name}/bias", 6)
        self._flicker = Flicker(seed, f"{name}/flicker", 6, period_s=period_s)
        turn_on = clock.stream(seed, f"{name}/turn_on").standard_normal(6)
        self._turn_on = _six(config.accel_turn_on_bias, config.gyro_turn_on_bias) * turn_on
        self._mixing = _mixing(config, seed)
        limits = _six(config.accel_range_mps2, config.gyro_range_radps)
        self._limits = np.where(limits > 0, limits, np.inf)

    def streams(self) -> dict[str, spaces.Space[Any]]:
        """One row: specific force [m/s²] then body rate [rad/s]."""
        return {self.config.name: spaces.Box(-1e5, 1e5, (6,), np.float32)}

    def bias(self, stamps_ns: Sequence[int]) -> Array:
        """True biases at M stamps [ns]: accelerometer [m/s²], gyroscope [rad/s], shape (M, 6)."""
        numbers = self._numbers(stamps_ns)
        total = self._turn_on + self._walk_scale * self._walk.rows(numbers)
        if self._flicker_scale.any():
            total = total + self._flicker_scale * self._flicker.rows(numbers)
        return total

    def measure(self, timeline: Timeline, stamps_ns: Sequence[int]) -> list[Sample]:
        """One `Imu` per stamp [ns]."""
        if not stamps_ns:
            return []
        motion = timeline.ego_motion(stamps_ns).at_mount(self._T_base_imu)
        truth = ideal(motion)
        if self._mixing is not None:
            truth = np.concatenate(
                [transforms.apply(transforms.from_rotation(M), truth[:, k : k + 3])
                 for M, k in zip(self._mixing, (0, 3), strict=True)], axis=-1
            )  # fmt: skip
        white = self._white_scale * self._white.rows(self._numbers(stamps_ns))
        rows = np.clip(truth + white + self.bias(stamps_ns), -self._limits, self._limits)
        attitudes = self._attitudes(motion)
        return [
            Imu(
                sensor=self.config.name,
                frame_id=self.config.frame_id,
                stamp_ns=int(stamp),
                specific_force_mps2=row[:3].copy(),
                angular_rate_radps=row[3:].copy(),
                quat_xyzw=attitude,
                orientation_noise_rad=self.config.orientation_noise_rad,
            )
            for stamp, row, attitude in zip(stamps_ns, rows, attitudes, strict=True)
        ]

    def _attitudes(self, motion: Motion) -> list[Array | None]:
        if self.config.orientation == "none":
            return [None] * len(motion.quat_xyzw)
        quats = motion.quat_xyzw
        if self.config.orientation_noise_rad:
            name = f"{self.config.name}/attitude"
            tilt = [clock.stream(self._seed, name, int(s)).standard_normal(3) for s in motion.stamp_ns]
            error = transforms.rotvec_to_quat(self.config.orientation_noise_rad * np.array(tilt))
            quats = transforms.quat_multiply(quats, error)
        return [quat.copy() for quat in quats]

    def _numbers(self, stamps_ns: Sequence[int]) -> NDArray[np.int64]:
        return np.asarray(stamps_ns, dtype=np.int64) // (self.schedule.period_ticks * TICK_NS)


def ideal(motion: Motion) -> Array:
    """Readings of a perfect IMU with this motion: R_WBᵀ(a − g) [m/s²] and ω_B [rad/s], shape (M, 6)."""
    force = motion.acceleration_world_mps2 + np.array([0.0, 0.0, GRAVITY_MPS2])
    body = transforms.quat_rotate(transforms.quat_conjugate(motion.quat_xyzw), force)
    return np.concatenate([body, motion.omega_body_radps], axis=-1)


def _six(accel: float, gyro: float) -> Array:
    return np.array([accel, accel, accel, gyro, gyro, gyro])


def _mixing(config: ImuConfig, seed: int) -> tuple[Array, Array] | None:
    """Matrices of scale and tilt of accelerometer and gyroscope (3, 3), or None when both are perfect."""
    if not config.scale_error and not config.misalignment_rad:
        return None
    drawn = clock.stream(seed, f"{config.name}/axes").standard_normal((2, 3, 3))
    spread = np.where(np.eye(3) > 0, config.scale_error, config.misalignment_rad)
    accel, gyro = np.eye(3) + spread * drawn
    return accel, gyro
