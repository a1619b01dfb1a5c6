"""Sensors of the vehicle itself: wheel encoders, speedometer, CAN bus.

Wheel odometry: ticks of the four wheels, slip and all.

Speedometer: forward speed of the rear axle.

CAN bus: steering, speed, gear and pedals as the car itself reports them, in the bus' coarse steps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from carlaloc_env.core import clock, transforms
from carlaloc_env.core.clock import TICK_NS
from carlaloc_env.core.ego import EGO_ROLLING_RADIUS_M, EGO_STEERING_RATIO
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.samples import CanState, Sample, Speed, WheelTicks
from carlaloc_env.sensors.base import Mount, Sensor, SensorConfig, World
from carlaloc_env.sensors.stochastic_processes import white
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
                speed_mps=float(v + (sigma * white(self._seed, name, stamp, 1)[0] if sigma else 0.0)),
            )
            for stamp, v in zip(stamps_ns, ahead, strict=True)
        ]


@dataclass(frozen=True, slots=True, kw_only=True)
class CanConfig(SensorConfig):
    """The car's own signals; steps are those usual on passenger cars' buses."""

    kind: ClassVar[str] = "can"

    name: str = "can"
    """Name of the sensor and its stream."""
    mount: Mount = field(default_factory=Mount)
    """Of no effect."""
    rate_hz: float = 100.0
    """Messages per second [Hz]."""
    steering_ratio: float = EGO_STEERING_RATIO
    """Turns of the steering wheel per turn of the road wheels, 12 = the ego's own."""
    wheel_radius_m: float = EGO_ROLLING_RADIUS_M
    """Rolling radius with which the car makes speeds out of spins [m]."""
    steering_step_deg: float = 0.1
    """Step of the steering wheel's angle [deg]."""
    steering_offset_deg: float = 1.0
    """Standard deviation of its constant error, an alignment left uncalibrated [deg]."""
    speed_step_mps: float = 0.01
    """Step of speeds [m/s]."""
    pedal_step: float = 0.004
    """Step of the pedals, 0.004 = 1/250 of their travel."""

    def __post_init__(self) -> None:
        SensorConfig.__post_init__(self)
        positive = (self.steering_ratio, self.wheel_radius_m)
        steps = (self.steering_step_deg, self.speed_step_mps, self.pedal_step)
        if not all(math.isfinite(v) and v > 0 for v in (*positive, *steps)) or self.steering_offset_deg < 0:
            raise ConfigError(
                f"CAN '{self.name}': ratio, radius and steps must be above 0, steering_offset_deg at least 0"
            )

    def build(self, world: World) -> CanSensor:
        """The bus in a world."""
        return CanSensor(self, world.seed)


class CanSensor(Sensor):
    """Rounds the true wheels and controls; speeds come from spins, so slip shows in them."""

    config: CanConfig

    def __init__(self, config: CanConfig, seed: int) -> None:
        super().__init__(config)
        drawn = clock.stream(seed, f"{config.name}/steering").standard_normal()
        self._offset_rad = math.radians(config.steering_offset_deg) * float(drawn)

    def streams(self) -> dict[str, spaces.Space[Any]]:
        """Steering wheel [rad], speed [m/s], throttle, brake (0–1), gear (1, −1), handbrake (0, 1)."""
        high = np.array([100.0, 200.0, 1.0, 1.0, 1.0, 1.0])
        low = np.array([-100.0, -200.0, 0.0, 0.0, -1.0, 0.0])
        return {self.config.name: spaces.Box(low, high, dtype=np.float64)}

    def measure(self, timeline: Timeline, stamps_ns: Sequence[int]) -> list[Sample]:
        """One `CanState` per stamp [ns]."""
        if not stamps_ns:
            return []
        config, car = self.config, timeline.car.at(stamps_ns)
        angle = car.road_wheel_rad * config.steering_ratio + self._offset_rad
        steering = _rounded(angle, math.radians(config.steering_step_deg))
        tread = _rounded(car.wheel_spin_radps * config.wheel_radius_m, config.speed_step_mps)
        speed = _rounded(0.5 * (tread[:, 2] + tread[:, 3]), config.speed_step_mps)
        throttle = np.minimum(_rounded(car.throttle, config.pedal_step), 1.0)
        brake = np.minimum(_rounded(car.brake, config.pedal_step), 1.0)
        return [
            CanState(
                sensor=config.name,
                frame_id=config.frame_id,
                stamp_ns=int(stamp),
                steering_wheel_rad=float(steering[k]),
                speed_mps=float(speed[k]),
                wheel_speed_mps=tread[k].copy(),
                throttle=float(throttle[k]),
                brake=float(brake[k]),
                gear=-1 if car.reverse[k] else 1,
                handbrake=bool(car.handbrake[k]),
            )
            for k, stamp in enumerate(stamps_ns)
        ]


def _rounded(values: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    result: NDArray[np.float64] = np.round(values / step) * step
    return result
