"""Car following and MOBIL, and the neighbours that both look at.

IDM+ takes the smaller of free-road and interaction acceleration (Schakel, van Arem & Netten,
"Effects of cooperative adaptive cruise control on traffic flow stability", ITSC 2010), so that
the gap in equilibrium is exactly s0 + v·T. Only + − × ÷ and √ are used: equal bits on every CPU.

MOBIL: incentive and safety criterion of lane changes.

Kesting, Treiber & Helbing, "General lane-changing model MOBIL for car-following models",
Transportation Research Record 1999 (2007).

Neighbours of a vehicle: its leader along the plan, and those ahead and behind on a lane beside.
"""

import numpy as np

from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.occupancy import (
    HORIZON_M,
    Occupancy,
    allowed_at,
    index_after,
    station_beside,
)
from carlaloc_env.traffic.tables.vehicle_state import PLAN, Drivers, Fleet

HARD_BRAKING_MPS2 = 8.0
"""Hardest braking on a dry road [m/s²]."""
FREE_MPS = 40.0
"""Desired speed that other drivers are taken to have [m/s]: so high that the gap alone decides. At town
speeds the free-road term of IDM+, 1 − (v/40)⁴, is within 2 % of 1."""


@compiled
def idm_plus(
    speed_mps: float,
    desired_mps: float,
    gap_m: float,
    leader_mps: float,
    headway_s: float,
    standstill_m: float,
    acceleration_mps2: float,
    braking_mps2: float,
) -> float:
    """Acceleration [m/s²], −8…+a.

    Args:
        speed_mps: Own speed [m/s].
        desired_mps: Desired speed [m/s].
        gap_m: Bumper-to-bumper gap to the leader [m], inf without one.
        leader_mps: Speed of the leader [m/s].
        headway_s: Time headway T [s].
        standstill_m: Gap s0 kept at a standstill [m].
        acceleration_mps2: Greatest acceleration a [m/s²].
        braking_mps2: Comfortable braking b [m/s²].
    """
    ratio = speed_mps / max(desired_mps, 0.1)
    squared = ratio * ratio
    free = max(1.0 - squared * squared, -2.5)
    closing = speed_mps * (speed_mps - leader_mps) / (2.0 * np.sqrt(acceleration_mps2 * braking_mps2))
    desired_gap = standstill_m + max(0.0, speed_mps * headway_s + closing)
    gap_ratio = desired_gap / max(gap_m, 0.1)
    return float(max(acceleration_mps2 * min(free, 1.0 - gap_ratio * gap_ratio), -HARD_BRAKING_MPS2))


@compiled
def follow(
    drivers: Drivers, v: int, speed_mps: float, desired_mps: float, gap_m: float, leader_mps: float
) -> float:
    """IDM+ acceleration of vehicle v with its driver's own headway, gap, acceleration and braking [m/s²].

    Args:
        drivers: All drivers, (N + 1,).
        v: The vehicle.
        speed_mps: Its speed [m/s].
        desired_mps: Speed that it would drive on a free road [m/s].
        gap_m: Bumper-to-bumper gap to the leader [m], inf without one.
        leader_mps: Speed of the leader [m/s].
    """
    return idm_plus(
        speed_mps,
        desired_mps,
        gap_m,
        leader_mps,
        drivers.headway_s[v],
        drivers.standstill_m[v],
        drivers.acceleration_mps2[v],
        drivers.braking_mps2[v],
    )


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


POLITENESS = 0.2
"""MOBIL's politeness p: weight of the followers' gain beside one's own; 0.2 to 0.5 in Kesting et al. 2007."""
SAFE_BRAKING_MPS2 = 3.0
"""MOBIL's b_safe: braking that a change may ask of any vehicle at most [m/s²]; 4 in Kesting et al. 2007."""
URGENT_BRAKING_MPS2 = 4.5
"""The same for changes that the path needs soon [m/s²]; ours, half of hard braking."""
_CRAWL_MPS = 0.5
"""Below this speed a change needs room to pull out [m/s]; ours."""
_PULL_OUT_ROOM_M = 4.0
"""That room ahead [m]: what a car needs to swing its front out of the lane; ours."""


@compiled
def mobil_incentive(
    occupancy: Occupancy, roads: Roads, drivers: Drivers, fleet: Fleet, v: int, target: int
) -> float:
    """MOBIL's incentive: own gain in acceleration and, times the politeness, the followers' [m/s²]."""
    lane, speed = fleet.plan[v, 0], fleet.speed_mps[v]
    half = 0.5 * drivers.length_m[v]
    station = station_beside(roads, lane, fleet.station_m[v], target)
    desired = min(allowed_at(roads, lane, fleet.station_m[v]) * drivers.speed_factor[v], drivers.top_mps[v])
    _, gap, front_speed, back, back_gap, back_speed = find_beside(occupancy, roads, target, station, v, half)
    _, own_gap, own_speed, old, old_gap, old_speed = find_beside(
        occupancy, roads, lane, fleet.station_m[v], v, half
    )
    mine = follow(drivers, v, speed, desired, gap, front_speed) - follow(
        drivers, v, speed, desired, own_gap, own_speed
    )
    others = 0.0
    if back >= 0:
        others += follow(drivers, back, back_speed, FREE_MPS, back_gap, speed)
        others -= follow(drivers, back, back_speed, FREE_MPS, back_gap + 2.0 * half + gap, front_speed)
    if old >= 0:
        others += follow(drivers, old, old_speed, FREE_MPS, old_gap + 2.0 * half + own_gap, own_speed)
        others -= follow(drivers, old, old_speed, FREE_MPS, old_gap, speed)
    return mine + POLITENESS * others


@compiled
def is_safe(
    occupancy: Occupancy, roads: Roads, drivers: Drivers, fleet: Fleet, v: int, target: int, urgent: bool
) -> bool:
    """Whether neither the vehicle nor its new follower would have to brake hard."""
    lane, speed = fleet.plan[v, 0], fleet.speed_mps[v]
    half = 0.5 * drivers.length_m[v]
    station = station_beside(roads, lane, fleet.station_m[v], target)
    _, gap, front_speed, back, back_gap, back_speed = find_beside(occupancy, roads, target, station, v, half)
    limit = URGENT_BRAKING_MPS2 if urgent else SAFE_BRAKING_MPS2
    if speed < _CRAWL_MPS and gap < _PULL_OUT_ROOM_M:
        return False
    if gap < 1.0 + 0.5 * max(speed - front_speed, 0.0) or back_gap < 1.0 + 0.5 * max(back_speed - speed, 0.0):
        return False
    if follow(drivers, v, speed, max(speed, 1.0), gap, front_speed) < -limit:
        return False
    return bool(back < 0 or follow(drivers, back, back_speed, max(back_speed, 1.0), back_gap, speed) > -limit)
