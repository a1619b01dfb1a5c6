"""A new kind of sensor in one file, a level 2-D laser scanner; `06_extend.py` writes it to a bag."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces

from carlaloc_env import Sample, Sensor, SensorConfig, Timeline, World, quat_rotate

ANGLES = np.radians(np.arange(-180.0, 180.0))
WHEN = np.zeros(len(ANGLES), np.int64)
RAYS = np.stack([np.cos(ANGLES), np.sin(ANGLES), 0 * ANGLES], axis=-1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ranges(Sample):
    """One turn of the laser, from straight behind anticlockwise: distances [m], inf where nothing is."""

    range_m: np.ndarray[Any, np.dtype[np.float32]]


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserConfig(SensorConfig):
    """A scanner that looks around in its x-y plane, all at one instant."""

    kind: ClassVar[str] = "laser"
    name: str = "laser"

    def build(self, world: World) -> Laser:
        """The scanner in a world."""
        return Laser(self, world)


class Laser(Sensor):
    """Casts its rays from its true pose against town and traffic."""

    def __init__(self, config: LaserConfig, world: World) -> None:
        super().__init__(config)
        self._world = world

    def streams(self) -> dict[str, spaces.Space[Any]]:
        """Distances [m]."""
        return {self.config.name: spaces.Box(0.0, np.inf, (len(ANGLES),), np.float32)}

    def measure(self, timeline: Timeline, stamps_ns: Sequence[int]) -> list[Sample]:
        """One `Ranges` per stamp [ns]."""
        name, found = self.config.name, list[Sample]()
        for stamp in stamps_ns:
            motion = timeline.ego_motion([stamp]).at_mount(self.config.mount.T_base_sensor)
            eye, along = motion.position_m + 0 * RAYS, quat_rotate(motion.quat_xyzw, RAYS)
            hits = self._world.rays().cast(eye, along, WHEN + stamp, timeline, 60.0, ego=False)
            found.append(Ranges(sensor=name, frame_id=name, stamp_ns=stamp, range_m=hits.range_m))
        return found
