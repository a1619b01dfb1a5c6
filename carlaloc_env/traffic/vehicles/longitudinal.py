"""Longitudinal motion of vehicles: accelerations behind leaders and before stops, speeds and stations."""

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.lane_geometry import allowed_at, station_beside
from carlaloc_env.traffic.tables.lane_tables import COMFORT_BRAKING_MPS2, Roads
from carlaloc_env.traffic.tables.occupancy import Occupancy, index_after, on_origin
from carlaloc_env.traffic.tables.uniform_draws import happens
from carlaloc_env.traffic.tables.vehicle_state import (
    HELD,
    PAST,
    PLAN,
    STANDING_MPS,
    STEP_S,
    DriverParameters,
    Drivers,
    Fleet,
)
from carlaloc_env.traffic.vehicles.car_following import FREE_MPS, follow, idm_plus
from carlaloc_env.traffic.vehicles.lane_plans import advance_goals, plan_ahead
from carlaloc_env.traffic.vehicles.neighbours import find_ahead, find_beside, find_leader

_COURTEOUS_BRAKING_MPS2 = 1.5
"""Braking with which drivers make room for others at most [m/s²]."""
_LETS_IN_RANGE_M = 45.0
"""Distance within which a driver lets a vehicle in that indicates [m]."""
_ALONGSIDE_M = 0.5
"""A vehicle closer behind than this is alongside, and drives on [m]."""
_LETS_IN_S = 4.0
"""A driver who has stood longer lets no vehicle in [s]."""
_FITS_IN_MPS = 2.0
"""Faster than this, a driver adapts to the gap beside [m/s]."""
_DRAW_IGNORE_VEHICLES = 22
"""Purpose of the draw for ignored vehicles."""


@compiled
def follow_leaders(
    occupancy: Occupancy,
    roads: Roads,
    drivers: Drivers,
    fleet: Fleet,
    parameters: DriverParameters,
    desired_mps2: Array,
    count: int,
    step: int,
) -> None:
    """Find the leader of each of the first `count` vehicles, and the IDM+ acceleration behind it.

    Writes `fleet.leader` and `gap_m` [m] and `desired_mps2` [m/s²], each (N + C,).
    """
    for v in range(count):
        half, speed = 0.5 * drivers.length_m[v], fleet.speed_mps[v]
        leader, gap, leader_speed = find_leader(occupancy, roads, fleet, v, half)
        fleet.leader[v], fleet.gap_m[v] = leader, gap
        side = fleet.origin[v]
        if side != 0 and on_origin(roads, drivers, fleet, v):
            lane = fleet.plan[v, 0]
            origin = roads.lane.left[lane] if side > 0 else roads.lane.right[lane]
            if origin >= 0:
                station = station_beside(roads, lane, fleet.station_m[v], origin)
                index = index_after(occupancy, origin, station)
                owner, other, other_speed = find_ahead(occupancy, roads, origin, index, station, v, half)
                if owner >= 0 and other < gap:
                    gap, leader_speed = other, other_speed
        second = (step + v) // 20
        if happens(parameters.ignore_vehicles, parameters.seed, _DRAW_IGNORE_VEHICLES, v, second):
            gap = np.inf
        desired_mps = min(_allowed(roads, fleet, v) * drivers.speed_factor[v], drivers.top_mps[v])
        desired_mps2[v] = follow(drivers, v, speed, desired_mps, gap, leader_speed)


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
def make_room_for_changes(
    occupancy: Occupancy, roads: Roads, drivers: Drivers, fleet: Fleet, desired_mps2: Array, count: int
) -> None:
    """Adapt vehicles that must change lanes to the gap beside; the first behind that gap lets them in.

    Lowers `desired_mps2` [m/s²], (N + C,), to a comfortable braking at most.
    """
    for v in range(count):
        if fleet.desired_side[v] == 0 or not fleet.urgent[v]:
            continue
        lane = fleet.plan[v, 0]
        target = roads.lane.left[lane] if fleet.desired_side[v] > 0 else roads.lane.right[lane]
        if target < 0:
            continue
        half, speed = 0.5 * drivers.length_m[v], fleet.speed_mps[v]
        station = station_beside(roads, lane, fleet.station_m[v], target)
        front, gap, front_speed, back, back_gap, back_speed = find_beside(
            occupancy, roads, target, station, v, half
        )
        if front >= 0 and speed > _FITS_IN_MPS:
            fit = follow(drivers, v, speed, max(speed, 1.0), max(gap, 0.5), front_speed)
            desired_mps2[v] = min(desired_mps2[v], max(fit, -_COURTEOUS_BRAKING_MPS2))
        # A vehicle alongside drives on: waiting there would keep the gap closed for both.
        sees = 0 <= back < count and _ALONGSIDE_M < back_gap < _LETS_IN_RANGE_M
        if sees and fleet.waited_s[back] < _LETS_IN_S:
            let = follow(drivers, back, back_speed, FREE_MPS, back_gap, speed)
            desired_mps2[back] = min(desired_mps2[back], max(let, -_COURTEOUS_BRAKING_MPS2))


@compiled
def brake_for_stops(drivers: Drivers, fleet: Fleet, desired_mps2: Array, count: int) -> None:
    """Brake for `fleet.stop_gap_m` [m], IDM+ behind a standing leader; lowers `desired_mps2`, (N + C,)."""
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
            desired_mps2[v] = min(desired_mps2[v], halt)


@compiled
def integrate_motion(fleet: Fleet, desired_mps2: Array, count: int) -> None:
    """Integrate speeds and stations of the first `count` vehicles over one step.

    Acceleration rises and falls as fast as a foot moves a pedal. Writes `acceleration_mps2`, `speed_mps`,
    `station_m`, `travelled_m`, `waited_s`, `stopped_s`, each (N + C,), and `held_front_m`.
    """
    for v in range(count):
        speed, a = fleet.speed_mps[v], fleet.acceleration_mps2[v]
        fall = 60.0 if desired_mps2[v] < -3.0 else 8.0
        a = min(max(desired_mps2[v], a - fall * STEP_S), a + 3.0 * STEP_S)
        after = speed + a * STEP_S
        if after < 0.0:
            distance = speed * speed / (-2.0 * a) if a < -1e-6 else 0.0
            a, after = 0.0, 0.0
        else:
            distance = speed * STEP_S + 0.5 * a * STEP_S * STEP_S
        fleet.acceleration_mps2[v], fleet.speed_mps[v] = a, after
        fleet.station_m[v] += distance
        fleet.travelled_m[v] += distance
        fleet.waited_s[v] = fleet.waited_s[v] + STEP_S if after < STANDING_MPS else 0.0
        if not fleet.at_stop_sign[v]:
            fleet.stopped_s[v] = 0.0
        elif after < STANDING_MPS:
            fleet.stopped_s[v] += STEP_S
        for k in range(HELD):
            if fleet.held_lane[v, k] >= 0:
                fleet.held_front_m[v, k] += distance


@compiled
def advance_lanes(roads: Roads, density: Array, fleet: Fleet, count: int, seed: int) -> None:
    """Move vehicles that have come to the end of their lane to the next lane of their plan.

    Writes `plan`, `past`, `station_m` and the goals of the first `count` vehicles.
    """
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
                advance_goals(fleet, v)
            plan_ahead(roads, density, fleet, v, seed)
