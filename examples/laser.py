"""A new kind of sensor in one file, a level 2-D laser scanner; `06_extend.py` writes it to a bag."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from carlaloc_env.geometry import quat_rotate
from carlaloc_env.samples import Sample
from carlaloc_env.sensors.base import Sensor, SensorConfig, World
from carlaloc_env.timeline import Timeline


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ranges(Sample):
    """One turn of the laser, from straight behind anticlockwise."""

    range_m: NDArray[np.float32]
    """Distances [m], inf where nothing is, shape (N,)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserConfig(SensorConfig):
    """A scanner that looks around in its x-y plane, all at one instant."""

    kind: ClassVar[str] = "laser"
    name: str = "laser"
    count: int = 360
    range_max_m: float = 60.0

    def build(self, world: World) -> Laser:
        return Laser(self, world)


class Laser(Sensor):
    """Casts its rays from its true pose against town and traffic."""

    def __init__(self, config: LaserConfig, world: World) -> None:
        super().__init__(config)
        self._own, self._world = config, world
        a = 2 * np.pi * np.arange(config.count) / config.count - np.pi
        self._rays = np.stack([np.cos(a), np.sin(a), 0 * a], axis=-1)

    def streams(self) -> dict[str, spaces.Space[Any]]:
        return {self._own.name: spaces.Box(0.0, np.inf, (self._own.count,), np.float32)}

    def measure(self, timeline: Timeline, stamps_ns: Sequence[int]) -> list[Sample]:
        own, found = self._own, list[Sample]()
        for stamp in stamps_ns:
            motion = timeline.ego_motion([stamp]).at_mount(own.mount.T_base_sensor)
            along = quat_rotate(motion.quat_xyzw, self._rays)
            eye, when = np.broadcast_to(motion.position_m, along.shape), np.full(own.count, stamp)
            hits = self._world.rays().cast(eye, along, when, timeline, own.range_max_m, ego=False)
            found.append(Ranges(sensor=own.name, frame_id=own.name, stamp_ns=stamp, range_m=hits.range_m))
        return found
