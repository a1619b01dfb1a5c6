"""Who drives in front, and who behind: along a plan, or beside on a neighbouring lane."""

from __future__ import annotations

import numpy as np

from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.occupancy import HORIZON_M, Presence, place_after
from carlaloc_env.traffic.tables.vehicle_state import PLAN, Fleet


@compiled
def first_on(there: Presence, lane: int, start: int, v: int) -> int:
    """First body of a lane from a place in `order` on that belongs to somebody else, −1 if none."""
    for place in range(start, there.first[lane + 1]):
        if there.body.owner[there.order[place]] != v:
            return int(there.order[place])
    return -1


@compiled
def find_leader(
    there: Presence, roads: Roads, fleet: Fleet, v: int, half_m: float
) -> tuple[int, float, float]:
    """Leader of a vehicle along its plan: its number (−1 = nobody), the gap [m], its speed [m/s]."""
    lane = fleet.plan[v, 0]
    row = first_on(there, lane, place_after(there, lane, fleet.station_m[v]), v)
    ahead = -fleet.station_m[v]
    for hop in range(PLAN):
        if hop > 0:
            ahead += roads.lane.length_m[lane]
            lane = fleet.plan[v, hop]
            if lane < 0 or ahead > HORIZON_M:
                break
            row = first_on(there, lane, there.first[lane], v)
        if row >= 0:
            gap = ahead + there.body.centre_m[row] - there.body.half_m[row] - half_m
            return int(there.body.owner[row]), float(gap), float(there.body.speed_mps[row])
    return -1, np.inf, 0.0


@compiled
def find_ahead(
    there: Presence, roads: Roads, lane: int, place: int, station_m: float, v: int, half_m: float
) -> tuple[int, float, float]:
    """Who is ahead on a lane that is not in the plan, from a place in its order on: owner, gap [m], speed."""
    row = first_on(there, lane, place, v)
    ahead, here = -station_m, lane
    for _ in range(4):
        if row >= 0:
            gap = ahead + there.body.centre_m[row] - there.body.half_m[row] - half_m
            return int(there.body.owner[row]), float(gap), float(there.body.speed_mps[row])
        ahead += roads.lane.length_m[here]
        if roads.lane.after_first[here] == roads.lane.after_end[here] or ahead > HORIZON_M:
            break
        here = roads.after[roads.lane.after_first[here]]
        row = first_on(there, here, there.first[here], v)
    return -1, np.inf, 0.0


@compiled
def find_beside(
    there: Presence, roads: Roads, lane: int, station_m: float, v: int, half_m: float
) -> tuple[int, float, float, int, float, float]:
    """Who would be ahead and behind on another lane at a station.

    Returns:
        Owner, gap [m] and speed [m/s] of the next ahead, then of the next behind; −1, inf, 0 for nobody.
    """
    place = place_after(there, lane, station_m)
    front, front_gap, front_speed = find_ahead(there, roads, lane, place, station_m, v, half_m)
    back, back_gap, back_speed = who_is_behind(there, roads, lane, place, station_m, v, half_m)
    return front, front_gap, front_speed, back, back_gap, back_speed


@compiled
def who_is_behind(
    there: Presence, roads: Roads, lane: int, place: int, station_m: float, v: int, half_m: float
) -> tuple[int, float, float]:
    """Who is behind a place in a lane's order, on it or the lanes before: owner, gap [m], speed [m/s]."""
    for k in range(place - 1, there.first[lane] - 1, -1):
        row = there.order[k]
        if there.body.owner[row] != v:
            gap = station_m - half_m - there.body.centre_m[row] - there.body.half_m[row]
            return int(there.body.owner[row]), float(gap), float(there.body.speed_mps[row])
    back, gap, speed = -1, np.inf, 0.0
    for k in range(roads.lane.before_first[lane], roads.lane.before_end[lane]):
        before, reach = roads.before[k], station_m - half_m
        for _ in range(3):
            row = _last_on(there, before, v)
            reach += roads.lane.length_m[before]
            if row >= 0:
                if reach - there.body.centre_m[row] - there.body.half_m[row] < gap:
                    gap = reach - there.body.centre_m[row] - there.body.half_m[row]
                    back, speed = there.body.owner[row], there.body.speed_mps[row]
                break
            if reach > 0.6 * HORIZON_M or roads.lane.before_first[before] == roads.lane.before_end[before]:
                break
            before = roads.before[roads.lane.before_first[before]]
    return int(back), float(gap), float(speed)


@compiled
def _last_on(there: Presence, lane: int, v: int) -> int:
    for place in range(there.first[lane + 1] - 1, there.first[lane] - 1, -1):
        if there.body.owner[there.order[place]] != v:
            return int(there.order[place])
    return -1
