"""Fixed units: sensors that stand by the road and see all cars of a drive."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.core.transforms import rpy_to_quat, transform
from carlaloc_env.timeline.timeline import Timeline
from recorder.episode.episode import Episode

PLACE_MAX_M = 1e5
"""Farthest place from the origin of the world [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RoadsideUnit:
    """Place of a fixed unit, whose rig is mounted on its `base_link` as it would be on that of a car."""

    number: int = 1
    """Number among the units of a replay, from 1."""
    position_m: tuple[float, float, float]
    """Place of its `base_link` in the world [m]."""
    yaw_deg: float
    """Direction that it faces, anticlockwise from east [deg]."""

    @property
    def name(self) -> str:
        """Name of its folder."""
        return f"roadside{self.number}"

    @property
    def T_world_unit(self) -> Array:
        """Maps its `base_link` to the world, shape (4, 4)."""
        quat = rpy_to_quat(0.0, 0.0, math.radians(self.yaw_deg))
        return transform(np.array(self.position_m), quat)

    def to_mapping(self) -> dict[str, Any]:
        """Its place as plain data."""
        return {"position_m": list(self.position_m), "yaw_deg": self.yaw_deg}


def timeline_of(episode: Episode, roadside: RoadsideUnit | None) -> Timeline:
    """A drive as its car, or a fixed unit, sees it."""
    return episode.timeline(None if roadside is None else roadside.T_world_unit)


def parse_roadside(text: str, number: int = 1) -> tuple[RoadsideUnit, str | None]:
    """Unit and rig, None where there is none, of a text ``x,y,z,yaw[,rig]``.

    Raises:
        ConfigError: it has another form, or numbers that are none.
    """
    words = text.split(",", 4)
    try:
        x, y, z, yaw = (float(word) for word in words[:4])
    except ValueError:
        raise ConfigError(
            f"roadside unit '{text}'; give x,y,z [m], yaw [deg] and perhaps a rig, such as 10,-4,5,90,lidar"
        ) from None
    if not all(abs(value) <= PLACE_MAX_M for value in (x, y, z, yaw)):
        raise ConfigError(f"roadside unit '{text}' lies outside every town; give metres and degrees")
    unit = RoadsideUnit(number=number, position_m=(x, y, z), yaw_deg=yaw)
    return unit, words[4].strip() if len(words) > 4 else None
