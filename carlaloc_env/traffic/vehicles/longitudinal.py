"""One step of all vehicles: accelerations from everything that counts, and the way that comes of them."""

from __future__ import annotations

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.hash_random import chance
from carlaloc_env.traffic.tables.lane_tables import Roads, allowed_at, station_beside
from carlaloc_env.traffic.tables.occupancy import Presence, on_origin, place_after
from carlaloc_env.traffic.tables.speed_profile import COMFORT_BRAKING_MPS2
from carlaloc_env.traffic.tables.vehicle_state import HELD, PAST, PLAN, Drivers, Fleet, Habits
from carlaloc_env.traffic.vehicles.car_following import idm_plus
from carlaloc_env.traffic.vehicles.lane_plans import plan_ahead, reach_goal
from carlaloc_env.traffic.vehicles.neighbours import find_ahead, find_beside, find_leader

STEP_S = STEP_NS / 1e9
_COURTEOUS_BRAKING_MPS2 = 1.5
_SEES_WISH_M, _BEHIND_M = 45.0, 0.5
_LETS_IN_S, _FITS_IN_MPS = 4.0, 2.0
_STANDING_MPS = 0.1
_IGNORES = 22


@compiled
def look_ahead(
    there: Presence,
    roads: Roads,
    drivers: Drivers,
    fleet: Fleet,
    habits: Habits,
    wanted: Array,
    count: int,
    step: int,
) -> None:
    """Find everybody's leader, and the acceleration wished for behind it [m/s²], (N,)."""
    for v in range(count):
        half, speed = 0.5 * drivers.length_m[v], fleet.speed_mps[v]
        leader, gap, leader_speed = find_leader(there, roads, fleet, v, half)
        fleet.leader[v], fleet.gap_m[v] = leader, gap
        side = fleet.origin[v]
        if side != 0 and on_origin(roads, drivers, fleet, v):
            lane = fleet.plan[v, 0]
            origin = roads.lane.left[lane] if side > 0 else roads.lane.right[lane]
            if origin >= 0:
                station = station_beside(roads, lane, fleet.station_m[v], origin)
                place = place_after(there, origin, station)
                owner, other, other_speed = find_ahead(there, roads, origin, place, station, v, half)
                if owner >= 0 and other < gap:
                    gap, leader_speed = other, other_speed
        second = (step + v) // 20
        if habits.ignore_vehicles > 0.0 and chance(habits.seed, _IGNORES, v, second) < habits.ignore_vehicles:
            gap = np.inf
        desired = min(_allowed(roads, fleet, v) * drivers.speed_factor[v], drivers.top_mps[v])
        wanted[v] = _follow(drivers, v, speed, desired, gap, leader_speed)


@compiled
def _allowed(roads: Roads, fleet: Fleet, v: int) -> float:
    """Speed that the lanes ahead allow here [m/s]."""
    lane = fleet.plan[v, 0]
    allowed = allowed_at(roads, lane, fleet.station_m[v])
    ahead = roads.lane.length_m[lane] - fleet.station_m[v]
    for hop in range(1, PLAN):
        if allowed * allowed < 2.0 * COMFORT_BRAKING_MPS2 * ahead:
            break
        lane = fleet.plan[v, hop]
        if lane < 0:
            break
        entry = roads.row.allowed_mps[roads.lane.row_first[lane]]
        allowed = min(allowed, np.sqrt(entry * entry + 2.0 * COMFORT_BRAKING_MPS2 * max(ahead, 0.0)))
        ahead += roads.lane.length_m[lane]
    return float(allowed)


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
def be_courteous(
    there: Presence, roads: Roads, drivers: Drivers, fleet: Fleet, wanted: Array, count: int
) -> None:
    """Who must change lanes fits its speed to the gap; the first behind that gap lets it in."""
    for v in range(count):
        if fleet.wish[v] == 0 or not fleet.urgent[v]:
            continue
        lane = fleet.plan[v, 0]
        target = roads.lane.left[lane] if fleet.wish[v] > 0 else roads.lane.right[lane]
        if target < 0:
            continue
        half, speed = 0.5 * drivers.length_m[v], fleet.speed_mps[v]
        station = station_beside(roads, lane, fleet.station_m[v], target)
        front, gap, front_speed, back, back_gap, back_speed = find_beside(
            there, roads, target, station, v, half
        )
        if front >= 0 and speed > _FITS_IN_MPS:
            fit = _follow(drivers, v, speed, max(speed, 1.0), max(gap, 0.5), front_speed)
            wanted[v] = min(wanted[v], max(fit, -_COURTEOUS_BRAKING_MPS2))
        # Who is alongside drives on: waiting there would keep the place from everybody.
        sees = 0 <= back < count and _BEHIND_M < back_gap < _SEES_WISH_M
        if sees and fleet.waited_s[back] < _LETS_IN_S:
            let = _follow(drivers, back, back_speed, 40.0, back_gap, speed)
            wanted[back] = min(wanted[back], max(let, -_COURTEOUS_BRAKING_MPS2))


@compiled
def stop_where_needed(drivers: Drivers, fleet: Fleet, wanted: Array, count: int) -> None:
    """Brake for the places to stop at."""
    for v in range(count):
        if fleet.stop_gap_m[v] < np.inf:
            halt = idm_plus(
                fleet.speed_mps[v],
                100.0,
                fleet.stop_gap_m[v],
                0.0,
                drivers.headway_s[v],
                0.5,
                drivers.acceleration_mps2[v],
                drivers.braking_mps2[v],
            )
            wanted[v] = min(wanted[v], halt)


@compiled
def drive(fleet: Fleet, wanted: Array, count: int) -> None:
    """Move everybody on by one step; accelerations change as fast as a foot moves a pedal."""
    for v in range(count):
        speed, a = fleet.speed_mps[v], fleet.acceleration_mps2[v]
        fall = 60.0 if wanted[v] < -3.0 else 8.0
        a = min(max(wanted[v], a - fall * STEP_S), a + 3.0 * STEP_S)
        after = speed + a * STEP_S
        if after < 0.0:
            path = speed * speed / (-2.0 * a) if a < -1e-6 else 0.0
            a, after = 0.0, 0.0
        else:
            path = speed * STEP_S + 0.5 * a * STEP_S * STEP_S
        fleet.acceleration_mps2[v], fleet.speed_mps[v] = a, after
        fleet.station_m[v] += path
        fleet.travelled_m[v] += path
        fleet.waited_s[v] = fleet.waited_s[v] + STEP_S if after < _STANDING_MPS else 0.0
        if not fleet.at_stop_sign[v]:
            fleet.stopped_s[v] = 0.0
        elif after < _STANDING_MPS:
            fleet.stopped_s[v] += STEP_S
        for k in range(HELD):
            if fleet.held_lane[v, k] >= 0:
                fleet.held_front_m[v, k] += path


@compiled
def enter_lanes(roads: Roads, crowd: Array, fleet: Fleet, count: int, seed: int) -> None:
    """Whoever has come to the end of its lane goes on to the next one of its plan."""
    for v in range(count):
        while fleet.station_m[v] >= roads.lane.length_m[fleet.plan[v, 0]]:
            lane, following = fleet.plan[v, 0], fleet.plan[v, 1]
            if following < 0:
                fleet.station_m[v] = roads.lane.length_m[lane]
                break
            fleet.station_m[v] -= roads.lane.length_m[lane]
            for k in range(PAST - 1, 0, -1):
                fleet.past[v, k] = fleet.past[v, k - 1]
            fleet.past[v, 0] = lane
            fleet.plan[v, 0] = following
            if roads.lane.junction[lane] >= 0 and roads.lane.junction[following] < 0:
                reach_goal(fleet, v)
            plan_ahead(roads, crowd, fleet, v, seed)
