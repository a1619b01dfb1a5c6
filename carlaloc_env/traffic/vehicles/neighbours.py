"""Neighbours of a vehicle: its leader along the plan, and those ahead and behind on a lane beside."""

import numpy as np

from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.occupancy import HORIZON_M, Occupancy, index_after
from carlaloc_env.traffic.tables.vehicle_state import PLAN, Fleet


@compiled
def first_on(occupancy: Occupancy, lane: int, start: int, v: int) -> int:
    """First body of a lane, from an index in `order` on, that does not belong to v, −1 if none."""
    for index in range(start, occupancy.first[lane + 1]):
        if occupancy.body.owner[occupancy.order[index]] != v:
            return int(occupancy.order[index])
    return -1


@compiled
def find_leader(
    occupancy: Occupancy, roads: Roads, fleet: Fleet, v: int, half_m: float
) -> tuple[int, float, float]:
    """Leader of a vehicle along its plan: its number (−1 = none), the gap [m], its speed [m/s]."""
    lane = fleet.plan[v, 0]
    row = first_on(occupancy, lane, index_after(occupancy, lane, fleet.station_m[v]), v)
    ahead = -fleet.station_m[v]
    for hop in range(PLAN):
        if hop > 0:
            ahead += roads.lane.length_m[lane]
            lane = fleet.plan[v, hop]
            if lane < 0 or ahead > HORIZON_M:
                break
            row = first_on(occupancy, lane, occupancy.first[lane], v)
        if row >= 0:
            gap = ahead + occupancy.body.centre_m[row] - occupancy.body.half_m[row] - half_m
            return int(occupancy.body.owner[row]), float(gap), float(occupancy.body.speed_mps[row])
    return -1, np.inf, 0.0


@compiled
def find_ahead(
    occupancy: Occupancy, roads: Roads, lane: int, index: int, station_m: float, v: int, half_m: float
) -> tuple[int, float, float]:
    """Vehicle ahead on a lane outside the plan, from an index in `order` on: owner, gap [m], speed [m/s]."""
    row = first_on(occupancy, lane, index, v)
    ahead, here = -station_m, lane
    for _ in range(4):
        if row >= 0:
            gap = ahead + occupancy.body.centre_m[row] - occupancy.body.half_m[row] - half_m
            return int(occupancy.body.owner[row]), float(gap), float(occupancy.body.speed_mps[row])
        ahead += roads.lane.length_m[here]
        if roads.lane.after_first[here] == roads.lane.after_end[here] or ahead > HORIZON_M:
            break
        here = roads.after[roads.lane.after_first[here]]
        row = first_on(occupancy, here, occupancy.first[here], v)
    return -1, np.inf, 0.0


@compiled
def find_beside(
    occupancy: Occupancy, roads: Roads, lane: int, station_m: float, v: int, half_m: float
) -> tuple[int, float, float, int, float, float]:
    """Vehicles that would be ahead and behind on another lane at a station.

    Returns:
        Owner, gap [m], speed [m/s] of the next ahead, then of the next behind; −1, inf, 0 without one.
    """
    index = index_after(occupancy, lane, station_m)
    front, front_gap, front_speed = find_ahead(occupancy, roads, lane, index, station_m, v, half_m)
    back, back_gap, back_speed = find_behind(occupancy, roads, lane, index, station_m, v, half_m)
    return front, front_gap, front_speed, back, back_gap, back_speed


@compiled
def find_behind(
    occupancy: Occupancy, roads: Roads, lane: int, index: int, station_m: float, v: int, half_m: float
) -> tuple[int, float, float]:
    """Vehicle behind an index of a lane's order, on it or on lanes before: owner, gap [m], speed [m/s]."""
    for k in range(index - 1, occupancy.first[lane] - 1, -1):
        row = occupancy.order[k]
        if occupancy.body.owner[row] != v:
            gap = station_m - half_m - occupancy.body.centre_m[row] - occupancy.body.half_m[row]
            return int(occupancy.body.owner[row]), float(gap), float(occupancy.body.speed_mps[row])
    back, gap, speed = -1, np.inf, 0.0
    for k in range(roads.lane.before_first[lane], roads.lane.before_end[lane]):
        before, distance = roads.before[k], station_m - half_m
        for _ in range(3):
            row = _last_on(occupancy, before, v)
            distance += roads.lane.length_m[before]
            if row >= 0:
                if distance - occupancy.body.centre_m[row] - occupancy.body.half_m[row] < gap:
                    gap = distance - occupancy.body.centre_m[row] - occupancy.body.half_m[row]
                    back, speed = occupancy.body.owner[row], occupancy.body.speed_mps[row]
                break
            if distance > 0.6 * HORIZON_M or roads.lane.before_first[before] == roads.lane.before_end[before]:
                break
            before = roads.before[roads.lane.before_first[before]]
    return int(back), float(gap), float(speed)


@compiled
def _last_on(occupancy: Occupancy, lane: int, v: int) -> int:
    """Last body of a lane that does not belong to v, −1 if none."""
    for index in range(occupancy.first[lane + 1] - 1, occupancy.first[lane] - 1, -1):
        if occupancy.body.owner[occupancy.order[index]] != v:
            return int(occupancy.order[index])
    return -1
