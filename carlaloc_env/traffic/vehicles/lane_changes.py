"""Changing lanes: MOBIL's incentive and safety, changes that the way asks for, and the motion aside.

MOBIL: Kesting, Treiber & Helbing, "General lane-changing model MOBIL for car-following models",
Transportation Research Record 1999 (2007).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.hash_random import chance
from carlaloc_env.traffic.tables.lane_tables import Roads, allowed_at, place_of, station_beside, width_at
from carlaloc_env.traffic.tables.occupancy import Presence
from carlaloc_env.traffic.tables.reservations import drop_holds_ahead
from carlaloc_env.traffic.tables.vehicle_state import PAST, REFUSED_ROOM, Drivers, Fleet, Habits
from carlaloc_env.traffic.vehicles.car_following import idm_plus
from carlaloc_env.traffic.vehicles.lane_plans import change_goal, find_way, plan_ahead
from carlaloc_env.traffic.vehicles.neighbours import find_beside

STEP_S = STEP_NS / 1e9
DECIDE_EVERY = 10
"""Steps between two thoughts about a lane change."""
POLITENESS = 0.2
THRESHOLD_MPS2 = 0.15
"""Gain from which a change is worth it [m/s²]."""
SAFE_BRAKING_MPS2, URGENT_BRAKING_MPS2 = 3.0, 4.5
"""What a change may ask of the follower at most; the latter in the last metres before one must [m/s²]."""
INDICATE_S = 1.0
"""How long drivers indicate before they move over [s]."""
CLEAR_OF_JUNCTION_M = 18.0
"""Changes for speed alone do not begin closer before a junction [m]."""
_URGENT_M = 150.0
_GIVE_UP_M = 22.0
_SHORTEST_M = 14.0
_CLEAR_S = 2.5
_NARROW_M = 0.5
_TIRED_S, _STOOD_S, _STUCK_S = 20.0, 3.0, 45.0
_FREE_ROOM_M = 120.0
_CRAWL_MPS, _START_ROOM_M = 0.5, 4.0
_LEFT, _RIGHT = 11, 12


@compiled
def think_of_changes(
    there: Presence,
    roads: Roads,
    drivers: Drivers,
    fleet: Fleet,
    habits: Habits,
    crowd: Array,
    taken: NDArray[np.int64],
    count: int,
    step: int,
) -> None:
    """Let drivers decide, indicate and begin lane changes.

    Args:
        there: What stands on the lanes.
        roads: The roads.
        drivers: Their habits.
        fleet: State, changed in place.
        habits: What applies to all.
        crowd: How full each stretch is.
        taken: Step at which somebody last moved into each lane: one a step.
        count: Number of vehicles.
        step: Number of this step.
    """
    for v in range(count):
        if fleet.change[v] < 1.0:
            # Whoever has come to a stand between two lanes where a further change is due gives it up.
            if fleet.waited_s[v] > _STOOD_S and fleet.plan[v, 1] < 0 and (step + v) % 20 == 0:
                change_goal(roads, crowd, fleet, v, habits.seed)
            if fleet.waited_s[v] > _STUCK_S and (step + v) % 20 == 0:
                _turn_back(roads, drivers, fleet, crowd, v, habits.seed)
            continue
        if fleet.wish[v] != 0:
            fleet.wished_s[v] += STEP_S
        ready = fleet.wish[v] != 0 and fleet.wished_s[v] >= INDICATE_S and (step + v) % 4 == 0
        if not ready and (step + v) % DECIDE_EVERY != 0:
            continue
        side, urgent = _best_side(there, roads, drivers, fleet, habits, crowd, v, step)
        fleet.urgent[v] = urgent
        if side != fleet.wish[v]:
            fleet.wish[v], fleet.wished_s[v] = side, 0.0
        elif side != 0 and fleet.wished_s[v] >= INDICATE_S:
            target = roads.lane.left[fleet.plan[v, 0]] if side > 0 else roads.lane.right[fleet.plan[v, 0]]
            if taken[target] != step and _is_safe(there, roads, drivers, fleet, v, target, urgent):
                taken[target] = step
                _begin(roads, drivers, fleet, crowd, v, side, target, habits.seed)


@compiled
def _turn_back(roads: Roads, drivers: Drivers, fleet: Fleet, crowd: Array, v: int, seed: int) -> None:
    """Give up a change that has hardly begun: whoever stands where the old lane ends may need the room."""
    side, lane = fleet.origin[v], fleet.plan[v, 0]
    old = roads.lane.left[lane] if side > 0 else roads.lane.right[lane]
    if side == 0 or old < 0 or side * fleet.aside_m[v] < 0.5 * fleet.spacing_m[v]:
        return
    fleet.waited_s[v] = 0.0
    _begin(roads, drivers, fleet, crowd, v, side, old, seed)


@compiled
def _best_side(
    there: Presence,
    roads: Roads,
    drivers: Drivers,
    fleet: Fleet,
    habits: Habits,
    crowd: Array,
    v: int,
    step: int,
) -> tuple[int, bool]:
    """Side to change to (0 = stay), and whether the way asks for it."""
    lane = fleet.plan[v, 0]
    if roads.lane.junction[lane] >= 0:
        return 0, False
    rest = roads.lane.length_m[lane] - fleet.station_m[v] - 0.5 * drivers.length_m[v]
    way = find_way(roads, lane, fleet.goals[v, 0])
    changes, must, room = 0, 0, np.inf
    if way >= 0:
        changes, must = roads.way.changes[way], roads.way.side[way]
        room = rest + roads.way.room_m[way]
    tired = fleet.waited_s[v] > 3.0 or room < _SHORTEST_M * changes
    if changes > 0 and room < _GIVE_UP_M * changes and tired:  # noqa: SIM102
        if change_goal(roads, crowd, fleet, v, habits.seed):
            return 0, False
    if fleet.refused[v] == REFUSED_ROOM and fleet.waited_s[v] > _TIRED_S and (step + v) % 100 < DECIDE_EVERY:
        change_goal(roads, crowd, fleet, v, habits.seed)
    ahead = fleet.plan[v, 1]
    clear = max(CLEAR_OF_JUNCTION_M, _CLEAR_S * fleet.speed_mps[v])
    if rest < clear and changes == 0 and (ahead < 0 or roads.lane.junction[ahead] >= 0):
        return 0, False
    if must != 0:
        target = roads.lane.left[lane] if must > 0 else roads.lane.right[lane]
        if _wide_enough(roads, drivers, fleet, v, lane, target):
            if room < (_URGENT_M + 2.0 * fleet.speed_mps[v]) * changes:
                return must, True
        elif changes > 0:
            return 0, False
    return _for_speed(there, roads, drivers, fleet, habits, v, step, changes, room), False


@compiled
def _wide_enough(roads: Roads, drivers: Drivers, fleet: Fleet, v: int, lane: int, target: int) -> bool:
    if target < 0:
        return False
    station = station_beside(roads, lane, fleet.station_m[v], target)
    return bool(width_at(roads, target, station) > drivers.width_m[v] + _NARROW_M)


@compiled
def _for_speed(
    there: Presence,
    roads: Roads,
    drivers: Drivers,
    fleet: Fleet,
    habits: Habits,
    v: int,
    step: int,
    changes: int,
    room_m: float,
) -> int:
    """Side on which driving would be better by more than the threshold, 0 if on none."""
    lane = fleet.plan[v, 0]
    best, best_gain = 0, 0.0
    for side in (1, -1):
        target = roads.lane.left[lane] if side > 0 else roads.lane.right[lane]
        if not _wide_enough(roads, drivers, fleet, v, lane, target):
            continue
        way = find_way(roads, target, fleet.goals[v, 0])
        luck = habits.random_left if side > 0 else habits.random_right
        whim = luck > 0.0 and chance(habits.seed, _LEFT if side > 0 else _RIGHT, v, step // 40) < luck
        if whim and (way >= 0 or roads.lane.lasting[target]):
            return side
        if fleet.goals[v, 0] >= 0:
            if way < 0:
                continue
            more = roads.way.changes[way]
            station = station_beside(roads, lane, fleet.station_m[v], target)
            left_m = roads.lane.length_m[target] - station + roads.way.room_m[way]
            if more > changes and left_m < _FREE_ROOM_M * more:
                continue
        elif not roads.lane.lasting[target]:
            continue
        if not habits.auto_lane_change:
            continue
        gain = _gain(there, roads, drivers, fleet, v, target) - THRESHOLD_MPS2
        gain += drivers.keeps_right[v] * (1.0 if side < 0 else -1.0)
        if fleet.wish[v] == side:
            gain += 0.1
        if gain > best_gain and _is_safe(there, roads, drivers, fleet, v, target, False):
            best, best_gain = side, gain
    return best


@compiled
def _follow(drivers: Drivers, v: int, speed: float, desired: float, gap: float, leader: float) -> float:
    return idm_plus(
        speed,
        desired,
        gap,
        leader,
        drivers.headway_s[v],
        drivers.standstill_m[v],
        drivers.acceleration_mps2[v],
        drivers.braking_mps2[v],
    )


@compiled
def _gain(there: Presence, roads: Roads, drivers: Drivers, fleet: Fleet, v: int, target: int) -> float:
    """MOBIL's incentive: own gain in acceleration and, times the politeness, the followers' [m/s²]."""
    lane, speed = fleet.plan[v, 0], fleet.speed_mps[v]
    half = 0.5 * drivers.length_m[v]
    station = station_beside(roads, lane, fleet.station_m[v], target)
    desired = min(allowed_at(roads, lane, fleet.station_m[v]) * drivers.speed_factor[v], drivers.top_mps[v])
    _, gap, front_speed, back, back_gap, back_speed = find_beside(there, roads, target, station, v, half)
    _, own_gap, own_speed, old, old_gap, old_speed = find_beside(
        there, roads, lane, fleet.station_m[v], v, half
    )
    mine = _follow(drivers, v, speed, desired, gap, front_speed) - _follow(
        drivers, v, speed, desired, own_gap, own_speed
    )
    others = 0.0
    if back >= 0:
        others += _follow(drivers, back, back_speed, 40.0, back_gap, speed)
        others -= _follow(drivers, back, back_speed, 40.0, back_gap + 2.0 * half + gap, front_speed)
    if old >= 0:
        others += _follow(drivers, old, old_speed, 40.0, old_gap + 2.0 * half + own_gap, own_speed)
        others -= _follow(drivers, old, old_speed, 40.0, old_gap, speed)
    return mine + POLITENESS * others


@compiled
def _is_safe(
    there: Presence, roads: Roads, drivers: Drivers, fleet: Fleet, v: int, target: int, urgent: bool
) -> bool:
    """Whether neither the vehicle nor its new follower would have to brake hard."""
    lane, speed = fleet.plan[v, 0], fleet.speed_mps[v]
    half = 0.5 * drivers.length_m[v]
    station = station_beside(roads, lane, fleet.station_m[v], target)
    _, gap, front_speed, back, back_gap, back_speed = find_beside(there, roads, target, station, v, half)
    limit = URGENT_BRAKING_MPS2 if urgent else SAFE_BRAKING_MPS2
    if speed < _CRAWL_MPS and gap < _START_ROOM_M:
        return False
    if gap < 1.0 + 0.5 * max(speed - front_speed, 0.0) or back_gap < 1.0 + 0.5 * max(back_speed - speed, 0.0):
        return False
    if _follow(drivers, v, speed, max(speed, 1.0), gap, front_speed) < -limit:
        return False
    return bool(
        back < 0 or _follow(drivers, back, back_speed, max(back_speed, 1.0), back_gap, speed) > -limit
    )


@compiled
def _begin(
    roads: Roads, drivers: Drivers, fleet: Fleet, crowd: Array, v: int, side: int, target: int, seed: int
) -> None:
    lane = fleet.plan[v, 0]
    station = station_beside(roads, lane, fleet.station_m[v], target)
    apart = 0.5 * (width_at(roads, lane, fleet.station_m[v]) + width_at(roads, target, station))
    # Where lanes run askew to their road, equal places along it do not lie side by side.
    x, y, c, s = place_of(roads, lane, fleet.station_m[v])
    there_x, there_y, there_c, there_s = place_of(roads, target, station)
    dx = x - fleet.aside_m[v] * s - there_x
    dy = y + fleet.aside_m[v] * c - there_y
    station += dx * there_c + dy * there_s
    drop_holds_ahead(fleet, v)
    fleet.station_m[v] = station
    fleet.plan[v, 0] = target
    here = target
    for k in range(PAST):
        old = fleet.past[v, k]
        new = -1
        for i in range(roads.lane.before_first[here], roads.lane.before_end[here]):
            before = roads.before[i]
            if new < 0 or before == old or roads.lane.left[before] == old or roads.lane.right[before] == old:
                new = before
        fleet.past[v, k] = new
        if new < 0:
            break
        here = new
    fleet.origin[v] = -side
    fleet.spacing_m[v] = apart
    fleet.aside_m[v] = dy * there_c - dx * there_s
    fleet.change[v] = 0.0
    fleet.wish[v], fleet.wished_s[v] = 0, 0.0
    plan_ahead(roads, crowd, fleet, v, seed)
