"""Speedometer: forward speed of the rear axle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces

from carlaloc_env.core import transforms
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.samples import Sample, Speed
from carlaloc_env.sensors.base import Mount, Sensor, SensorConfig, World
from carlaloc_env.sensors.inertial.stochastic_processes import white
from carlaloc_env.timeline.timeline import Timeline


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
