"""Sensors of the vehicle itself: encoders on the four wheels, slip and all, and the speedometer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces

from carlaloc_env.core import clock, transforms
from carlaloc_env.core.clock import TICK_NS
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.samples import Sample, Speed, WheelTicks
from carlaloc_env.sensors.base import Mount, Sensor, SensorConfig, World
from carlaloc_env.sensors.stochastic_processes import white_noise
from carlaloc_env.timeline.timeline import Timeline


@dataclass(frozen=True, slots=True, kw_only=True)
class WheelsConfig(SensorConfig):
    """Encoders on the four wheels, as of an anti-lock brake system that reports directions."""

    kind: ClassVar[str] = "wheels"

    name: str = "wheels"
    """Name of the sensor and its stream."""
    mount: Mount = field(default_factory=Mount)
    """Of no effect: the wheels are where the car has them, `base_link` between the rear ones."""
    rate_hz: float = 100.0
    """Measurements per second [Hz]."""
    ticks_per_turn: int = 96
    """Ticks in one turn, 96 = both edges of a ring of 48 teeth."""

    def __post_init__(self) -> None:
        SensorConfig.__post_init__(self)
        if self.ticks_per_turn < 1:
            raise ConfigError(f"wheels '{self.name}': ticks_per_turn {self.ticks_per_turn}; give at least 1")

    def build(self, world: World) -> WheelsSensor:
        """The encoders in a world."""
        return WheelsSensor(self, world.seed)


class WheelsSensor(Sensor):
    """Counts teeth that have passed since the drive began; each ring begins at its own angle.

    The angles are the physics' own, so that wheels slip under brakes and power and the outer ones
    turn faster in a bend.
    """

    config: WheelsConfig

    def __init__(self, config: WheelsConfig, seed: int) -> None:
        super().__init__(config)
        self._offset = clock.stream(seed, f"{config.name}/offset").random(4)

    def streams(self) -> dict[str, spaces.Space[Any]]:
        """Ticks of four wheels, then their spin [rad/s]: front left, front right, rear left, rear right."""
        return {self.config.name: spaces.Box(-1e12, 1e12, (8,), np.float64)}

    def measure(self, timeline: Timeline, stamps_ns: Sequence[int]) -> list[Sample]:
        """One `WheelTicks` per stamp [ns]."""
        if not stamps_ns:
            return []
        period_ns = self.schedule.period_ticks * TICK_NS
        stamps = np.asarray(stamps_ns, dtype=np.int64)
        before = np.maximum(stamps - period_ns, 0)
        per_rad = self.config.ticks_per_turn / (2.0 * math.pi)
        now, then = (
            np.floor(timeline.car.at(times).wheel_angle_rad * per_rad + self._offset).astype(np.int64)
            for times in (stamps, before)
        )
        rate = (now - then) / per_rad / (period_ns * 1e-9)
        return [
            WheelTicks(
                sensor=self.config.name,
                frame_id=self.config.frame_id,
                stamp_ns=int(stamp),
                ticks=ticks.copy(),
                rate_radps=spin.copy(),
                ticks_per_turn=self.config.ticks_per_turn,
            )
            for stamp, ticks, spin in zip(stamps_ns, now, rate, strict=True)
        ]


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedConfig(SensorConfig):
    """The car's own speedometer; exact unless noise is asked for."""

    kind: ClassVar[str] = "speed"

    name: str = "speed"
    """Name of the sensor and its stream."""
    mount: Mount = field(default_factory=Mount)
    """Where the speed is measured; `base_link` lies on the rear axle."""
    rate_hz: float = 20.0
    """Measurements per second [Hz]."""
    noise_mps: float = 0.0
    """Standard deviation [m/s]."""

    def __post_init__(self) -> None:
        SensorConfig.__post_init__(self)
        if not (np.isfinite(self.noise_mps) and self.noise_mps >= 0):
            raise ConfigError(f"speed sensor '{self.name}': noise_mps {self.noise_mps}; give a number ≥ 0")

    def build(self, world: World) -> SpeedSensor:
        """The speedometer in a world."""
        return SpeedSensor(self, world.seed)


class SpeedSensor(Sensor):
    """Velocity of the mount along its own x axis."""

    config: SpeedConfig

    def __init__(self, config: SpeedConfig, seed: int) -> None:
        super().__init__(config)
        self._seed = seed
        self._T_base_sensor = config.mount.T_base_sensor

    def streams(self) -> dict[str, spaces.Space[Any]]:
        """Forward speed [m/s]."""
        return {self.config.name: spaces.Box(-1e3, 1e3, (1,), np.float32)}

    def measure(self, timeline: Timeline, stamps_ns: Sequence[int]) -> list[Sample]:
        """One `Speed` per stamp [ns]."""
        if not stamps_ns:
            return []
        motion = timeline.ego_motion(stamps_ns).at_mount(self._T_base_sensor)
        to_body = transforms.quat_conjugate(motion.quat_xyzw)
        ahead = transforms.quat_rotate(to_body, motion.velocity_world_mps)[:, 0]
        sigma, name = self.config.noise_mps, f"{self.config.name}/speed"
        return [
            Speed(
                sensor=self.config.name,
                frame_id=self.config.frame_id,
                stamp_ns=int(stamp),
                speed_mps=float(v + (sigma * white_noise(self._seed, name, stamp, 1)[0] if sigma else 0.0)),
            )
            for stamp, v in zip(stamps_ns, ahead, strict=True)
        ]
