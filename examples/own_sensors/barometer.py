"""A new kind of sensor in one file, a barometer; `05_new_sensor.py` uses it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces

from carlaloc_env import Sample, Sensor, SensorConfig, Timeline, World, white_noise


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pressure(Sample):
    """One reading of the barometer."""

    pressure_pa: float
    """Static air pressure [Pa]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BarometerConfig(SensorConfig):
    """A barometer in the International Standard Atmosphere (ISO 2533)."""

    kind: ClassVar[str] = "barometer"
    name: str = "barometer"
    noise_pa: float = 1.0
    """Standard deviation [Pa]; 1 Pa is 8 cm of height."""

    def build(self, world: World) -> Barometer:
        """The barometer in a world."""
        return Barometer(self, world)


class Barometer(Sensor):
    """Reads p = 101325 (1 − 2.25577e-5 h)^5.25588 at its true height h above the ellipsoid."""

    def __init__(self, config: BarometerConfig, world: World) -> None:
        super().__init__(config)
        self._own, self._world = config, world

    def streams(self) -> dict[str, spaces.Space[Any]]:
        """Pressure [Pa]."""
        return {self._own.name: spaces.Box(0.0, 2e5, (1,), np.float32)}

    def measure(self, timeline: Timeline, stamps_ns: Sequence[int]) -> list[Sample]:
        """One `Pressure` per stamp [ns]."""
        return [self._reading(timeline, int(stamp)) for stamp in stamps_ns]

    def _reading(self, timeline: Timeline, stamp_ns: int) -> Pressure:
        c, world = self._own, self._world
        up_m = timeline.ego_motion([stamp_ns]).at_mount(c.mount.T_base_sensor).position_m[0, 2]
        exact_pa = 101325.0 * (1.0 - 2.25577e-5 * (world.geo.height_m + up_m)) ** 5.25588
        pressure_pa = float(
            exact_pa + c.noise_pa * white_noise(world.seed, f"{c.name}/pressure", stamp_ns, 1)[0]
        )
        return Pressure(sensor=c.name, frame_id=c.frame_id, stamp_ns=stamp_ns, pressure_pa=pressure_pa)
