"""CAN bus: steering, speed, gear and pedals as the car itself reports them, in the bus' coarse steps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from carlaloc_env.core import clock
from carlaloc_env.core.ego import EGO_ROLLING_RADIUS_M, EGO_STEERING_RATIO
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.samples import CanState, Sample
from carlaloc_env.sensors.base import Mount, Sensor, SensorConfig, World
from carlaloc_env.timeline.timeline import Timeline


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
