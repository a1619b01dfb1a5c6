"""IMU: specific force and body rate from the true spline, with white noise and walking biases."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from carlaloc_env import geometry
from carlaloc_env.clock import TICK_NS
from carlaloc_env.errors import ConfigError
from carlaloc_env.samples import Imu, Sample
from carlaloc_env.sensors.base import Mount, Sensor, SensorConfig, World
from carlaloc_env.sensors.noise import RandomWalk, WhiteSequence
from carlaloc_env.timeline import Timeline
from carlaloc_env.trajectory import Motion

GRAVITY_MPS2 = 9.81
"""Gravity along −z of the world [m/s²]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuConfig(SensorConfig):
    """An IMU in Kalibr's convention: continuous-time densities, not per-sample deviations.

    The defaults are the CARLA-Loc paper's, which are those of EuRoC's ADIS16448 rounded.
    """

    kind: ClassVar[str] = "imu"

    name: str = "imu"
    """Name of the sensor, its stream and its frame."""
    mount: Mount = field(default_factory=Mount)
    """Where it sits on the car."""
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

    def __post_init__(self) -> None:
        SensorConfig.__post_init__(self)
        values = (
            self.accel_noise_density,
            self.gyro_noise_density,
            self.accel_random_walk,
            self.gyro_random_walk,
        )
        if not all(math.isfinite(v) and v >= 0 for v in values):
            raise ConfigError(f"IMU '{self.name}': noise figures {values}; give finite numbers ≥ 0")

    def build(self, world: World) -> ImuSensor:
        """The IMU in a world."""
        return ImuSensor(self, world.seed)


class ImuSensor(Sensor):
    """Reads the motion of its own mount; at rest its up axis shows +9.81 m/s²."""

    config: ImuConfig

    def __init__(self, config: ImuConfig, seed: int) -> None:
        super().__init__(config)
        self._T_base_imu = config.mount.T_base_sensor
        period_s = 1.0 / config.rate_hz
        a, g = config.accel_noise_density, config.gyro_noise_density
        self._white_scale = np.array([a, a, a, g, g, g]) / math.sqrt(period_s)
        a, g = config.accel_random_walk, config.gyro_random_walk
        self._walk_scale = np.array([a, a, a, g, g, g]) * math.sqrt(period_s)
        self._white = WhiteSequence(seed, f"{config.name}/white", 6)
        self._walk = RandomWalk(seed, f"{config.name}/bias", 6)

    def streams(self) -> dict[str, spaces.Space[Any]]:
        """One row: specific force [m/s²] then body rate [rad/s]."""
        return {self.config.name: spaces.Box(-1e5, 1e5, (6,), np.float32)}

    def bias(self, stamps_ns: Sequence[int]) -> NDArray[np.float64]:
        """True biases at M stamps [ns]: accelerometer [m/s²], gyroscope [rad/s], shape (M, 6)."""
        return self._walk_scale * self._walk.rows(self._numbers(stamps_ns))

    def measure(self, timeline: Timeline, stamps_ns: Sequence[int]) -> list[Sample]:
        """One `Imu` per stamp [ns]."""
        if not stamps_ns:
            return []
        truth = ideal(timeline.ego_motion(stamps_ns).at_mount(self._T_base_imu))
        numbers = self._numbers(stamps_ns)
        rows = truth + self._white_scale * self._white.rows(numbers) + self.bias(stamps_ns)
        return [
            Imu(
                sensor=self.config.name,
                frame_id=self.config.frame_id,
                stamp_ns=int(stamp),
                specific_force_mps2=row[:3].copy(),
                angular_rate_radps=row[3:].copy(),
            )
            for stamp, row in zip(stamps_ns, rows, strict=True)
        ]

    def _numbers(self, stamps_ns: Sequence[int]) -> NDArray[np.int64]:
        return np.asarray(stamps_ns, dtype=np.int64) // (self.schedule.period_ticks * TICK_NS)


def ideal(motion: Motion) -> NDArray[np.float64]:
    """What a perfect IMU with this motion reads: R_WBᵀ(a − g) [m/s²] and ω_B [rad/s], shape (M, 6)."""
    force = motion.acceleration_world_mps2 + np.array([0.0, 0.0, GRAVITY_MPS2])
    body = geometry.quat_rotate(geometry.quat_conjugate(motion.quat_xyzw), force)
    return np.concatenate([body, motion.omega_body_radps], axis=-1)
