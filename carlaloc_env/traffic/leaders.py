"""Who drives in front: one sort over all vehicles, then a walk along the plans of those in the lead."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

HORIZON_M = 120.0
"""How far drivers look for somebody in front [m]."""
_LANE_KEY = 1e5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Occupancy:
    """Everything that stands on a lane: vehicles, their tails on the lane behind, the ego."""

    lane: Index
    """Lane of each entry, shape (E,)."""
    station_m: Array
    """Station of its centre [m], shape (E,)."""
    half_m: Array
    """Half its length [m], shape (E,)."""
    speed_mps: Array
    """Its speed along the lane [m/s], shape (E,)."""

    def rearmost(self, lane_count: int) -> tuple[Array, Array]:
        """Rear end [m] and speed [m/s] of the last entry of every lane, inf and 0 where empty."""
        rear = np.full(lane_count, np.inf)
        speed = np.zeros(lane_count)
        order = np.argsort(-(self.station_m - self.half_m), kind="stable")
        rear[self.lane[order]] = (self.station_m - self.half_m)[order]
        speed[self.lane[order]] = self.speed_mps[order]
        return rear, speed


def find_leaders(occupancy: Occupancy, count: int, plan: Index, lane_length_m: Array) -> tuple[Array, Array]:
    """Gap [m] and speed [m/s] of the leader of the first `count` entries, inf and 0 without one.

    Args:
        occupancy: All entries; the first `count` are the vehicles that look.
        count: Number of vehicles N.
        plan: Lanes each vehicle will drive, the present one first, −1 = none, shape (N, P).
        lane_length_m: Length of every lane [m].
    """
    key = occupancy.lane * _LANE_KEY + occupancy.station_m
    order = np.argsort(key, kind="stable")
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    following = order[np.minimum(place[:count] + 1, len(order) - 1)]
    same = (place[:count] + 1 < len(order)) & (occupancy.lane[following] == occupancy.lane[:count])
    front = occupancy.station_m[:count] + occupancy.half_m[:count]
    rear = occupancy.station_m[following] - occupancy.half_m[following]
    gap = np.where(same, rear - front, np.inf)
    speed = np.where(same, occupancy.speed_mps[following], 0.0)

    first_rear, first_speed = occupancy.rearmost(len(lane_length_m))
    travelled = lane_length_m[plan[:, 0]] - front
    searching = ~same
    for hop in range(1, plan.shape[1]):
        lane = plan[:, hop]
        searching &= (lane >= 0) & (travelled < HORIZON_M)
        if not searching.any():
            break
        there = searching & np.isfinite(first_rear[lane])
        gap = np.where(there, travelled + first_rear[lane], gap)
        speed = np.where(there, first_speed[lane], speed)
        searching &= ~there
        travelled = travelled + np.where(lane >= 0, lane_length_m[lane], 0.0)
    return gap, speed
