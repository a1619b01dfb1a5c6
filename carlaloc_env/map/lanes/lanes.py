"""Lanes, and what stands along them, as records: traffic lights, signs, crosswalks."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

SignKind = Literal["stop", "yield", "speed", "other"]
"""Meaning of a sign for drivers."""
SIGN_CODES: dict[SignKind, str] = {"stop": "206", "yield": "205", "speed": "274"}
"""CARLA's and RoadRunner's sign codes (after the German catalogue)."""
SIGN_KINDS = {code: kind for kind, code in SIGN_CODES.items()}
"""Kind of sign by code."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Lane:
    """One lane of one lane section. Stations run in travel direction along the lane's centre."""

    index: int
    road_id: str
    section: int
    lane_id: int
    type: str
    length_m: float
    junction_id: str | None
    forward: bool
    """True if traffic runs with growing s."""
    successors: tuple[int, ...]
    predecessors: tuple[int, ...]
    left: int | None
    """Driving lane to the left with the same travel direction."""
    right: int | None
    """Driving lane to the right with the same travel direction."""
    speed_limit_mps: float
    """Lowest limit on the lane."""

    @property
    def kerb_side(self) -> int:
        """Side on which the kerb lies for its driver: −1 right, 1 left where traffic keeps to the left."""
        return -1 if (self.lane_id < 0) == self.forward else 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SignalHead:
    """A dynamic traffic light."""

    id: str
    name: str
    type: str
    T_world_signal: NDArray[np.float64]
    """Pose (4, 4); x faces the drivers it speaks to, z up."""
    width_m: float
    height_m: float
    lanes: tuple[int, ...]
    """Lanes that must stop for it."""
    stop_station_m: tuple[float, ...]
    """Where each of them must stop."""
    junction_lanes: tuple[int, ...]
    """Lanes inside the junction that it opens and closes."""
    controller_id: str | None
    junction_id: str | None
    sequence: int | None
    """Number of its controller in that junction: equal ones are green together."""
    road_id: str
    s_m: float
    t_m: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StaticSign:
    """A sign that never changes."""

    id: str
    kind: SignKind
    type: str
    T_world_sign: NDArray[np.float64]
    """Pose (4, 4); x faces the drivers it speaks to, z up."""
    lanes: tuple[int, ...]
    stop_station_m: tuple[float, ...]
    """Where each lane meets the sign: the stop line of stop and yield signs."""
    speed_mps: float | None
    road_id: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Crosswalk:
    """A marked way for walkers across a road."""

    id: str
    road_id: str
    polygon_m: NDArray[np.float64]
    """World outline, first corner not repeated, (K, 3)."""
    start_m: NDArray[np.float64]
    """Middle of one kerb side (3,)."""
    end_m: NDArray[np.float64]
    """Middle of the other kerb side (3,)."""
    width_m: float
    """Extent along the road."""
    lanes: tuple[int, ...]
    """Driving lanes that it crosses."""
    span_m: tuple[tuple[float, float], ...]
    """Stations between which each of them is crossed."""
