"""The ego as other road users see it, and the lanes it stands on and heads for."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.town.network import LaneNetwork

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_TOUCH_M = 2.0
_HEAD_FOR_M = 1.5
_LOOK_AHEAD_S = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class EgoView:
    """What other road users see of the ego."""

    position_m: tuple[float, float, float]
    """Centre of the ego's box on the ground [m], world."""
    heading_rad: float
    """Heading [rad]."""
    speed_mps: float
    """Forward speed [m/s]."""
    length_m: float = 4.7
    """Length of the ego [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EgoLanes:
    """Lanes that the ego occupies, and those it reaches within two seconds."""

    lane: Index
    """Lanes its box touches, shape (K,)."""
    station_m: Array
    """Station of its centre on them [m], shape (K,)."""
    speed_mps: Array
    """Its speed along them [m/s], shape (K,)."""
    ahead: tuple[tuple[int, float], ...]
    """Lane and station [m] of points before its front, straight on, nearest first."""


def find_ego_lanes(network: LaneNetwork, lane_length_m: Array, ego: EgoView) -> EgoLanes:
    """Where the ego is on the lanes: those nearest to its centre line, shifted by half its width."""
    c, s = math.cos(ego.heading_rad), math.sin(ego.heading_rad)
    reach = np.arange(0.0, max(_LOOK_AHEAD_S * ego.speed_mps, 0.5), 1.0)
    body = np.repeat([-0.4 * ego.length_m, 0.0, 0.4 * ego.length_m], 3)
    along = np.concatenate([body, reach])
    side = np.concatenate([np.tile([-0.7, 0.0, 0.7], 3), 0.0 * reach])
    offset = np.stack([along * c - side * s, along * s + side * c, np.zeros(len(along))], axis=-1)
    # One search for both questions: its cost hardly depends on the number of points.
    nearest = network.nearest(np.array(ego.position_m) + offset)
    count = len(body)
    near = np.flatnonzero(nearest.distance_m[:count] < _TOUCH_M)
    touched, first = np.unique(nearest.lane[near], return_index=True)
    station = nearest.station_m[near[first]] - body[near[first]]
    heading = network.pose(touched, np.clip(station, 0.0, lane_length_m[touched])).heading_rad
    on_way = np.flatnonzero(nearest.distance_m[count:] < _HEAD_FOR_M) + count
    return EgoLanes(
        lane=touched.astype(np.int64),
        station_m=station,
        speed_mps=np.maximum(0.0, ego.speed_mps * np.cos(heading - ego.heading_rad)),
        ahead=tuple(zip(nearest.lane[on_way].tolist(), nearest.station_m[on_way].tolist(), strict=True)),
    )
