"""Yielding inside a junction: stop before zones that are not clear, give up zones that lie behind."""

import numpy as np

from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.conflict_times import is_conflict_free
from carlaloc_env.traffic.tables.conflict_zones import CROSSING, MERGING, PARTING
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.request_queue import Requests
from carlaloc_env.traffic.tables.vehicle_state import (
    HELD,
    PLAN,
    STANDING_MPS,
    STEP_S,
    Drivers,
    Fleet,
)
from carlaloc_env.traffic.vehicles.ego_agent import EgoBoxes, box_of, passes_ego

_STANDING_INSIDE_S = 8.0
"""A vehicle that has waited longer inside a junction moves on before vehicles that stand [s]."""
_GOES_FIRST_S = 5.0
"""So long it keeps going before them: to have begun is not to be through [s]."""
_BEFORE_ZONE_M = 0.6
"""Gap to a zone before which a vehicle stops [m]."""
_NOSE_M = 1.0
"""A front so far inside a zone does not bar it: zones begin 2.9 m before the other lane's middle [m]."""
_HARD_BRAKING_MPS2 = 6.0
"""Braking of a vehicle that stops there at most [m/s²]."""
_EGO_BRAKING_MPS2 = 3.0
"""Braking that a vehicle which can no longer stop there expects of the ego [m/s²]."""


@compiled
def wait_inside(
    requests: Requests, roads: Roads, drivers: Drivers, fleet: Fleet, egos: EgoBoxes, count: int
) -> None:
    """Stop before zones on the path that a vehicle admitted earlier, or one standing there, holds.

    Before an ego, whose way on is not known, a vehicle stops at the edge of the first zone, or drives on
    through all. Between them it would stand in the ego's way, and each would wait for the other.

    Writes `fleet.stop_gap_m` and `goes_first_s`, each (N + C,), for the first `count` vehicles.
    """
    for v in range(count):
        if fleet.waited_s[v] > _STANDING_INSIDE_S:
            fleet.goes_first_s[v] = _GOES_FIRST_S
        else:
            fleet.goes_first_s[v] = max(fleet.goes_first_s[v] - STEP_S, 0.0)
        passes = 0
        for ego in range(len(egos.speed_mps)):
            if _passes_ego(roads, drivers, fleet, egos, count, ego, v):
                passes |= 1 << ego
        for slot in range(HELD):
            lane = fleet.held_lane[v, slot]
            if lane < 0:
                continue
            front = fleet.held_front_m[v, slot]
            for z in range(roads.lane.zone_first[lane], roads.lane.zone_end[lane]):
                to_zone = roads.zone.enter_m[z] - front
                at_edge = _halts_at_edge(roads, fleet, v, z, to_zone)
                if roads.zone.kind[z] == PARTING or (to_zone < 0.0 and not at_edge):
                    continue
                if _must_wait(requests, roads, drivers, fleet, count, v, slot, z, to_zone, passes):
                    gap = max(to_zone - _BEFORE_ZONE_M, 0.0)
                    fleet.stop_gap_m[v] = min(fleet.stop_gap_m[v], gap)


@compiled
def _passes_ego(
    roads: Roads, drivers: Drivers, fleet: Fleet, egos: EgoBoxes, count: int, ego: int, v: int
) -> bool:
    """Whether vehicle v can no longer stop before zones of an ego, and that ego has room to brake.

    If the ego stands in such a zone, the way past it must be clear.
    """
    bars, ego_gap_m, distance_m, me = False, np.inf, 0.0, count + ego
    for slot in range(HELD):
        lane, front = fleet.held_lane[v, slot], fleet.held_front_m[v, slot]
        if lane < 0:
            continue
        for z in range(roads.lane.zone_first[lane], roads.lane.zone_end[lane]):
            way = roads.zone.leave_m[z] + drivers.length_m[v] - front
            if roads.zone.kind[z] != CROSSING or way < 0.0:
                continue
            for k in range(HELD):
                if fleet.held_lane[me, k] == roads.zone.other[z]:
                    bars = bars or not _halts_at_edge(roads, fleet, v, z, roads.zone.enter_m[z] - front)
                    ego_gap_m = min(ego_gap_m, roads.zone.other_enter_m[z] - fleet.held_front_m[me, k])
                    distance_m = max(distance_m, way)
    speed = egos.speed_mps[ego]
    if not bars or speed * speed < 2.0 * _EGO_BRAKING_MPS2 * ego_gap_m:
        return bars
    if speed >= STANDING_MPS:
        return False
    return passes_ego(roads, drivers, fleet, box_of(egos, ego), v, distance_m)


@compiled
def _halts_at_edge(roads: Roads, fleet: Fleet, v: int, z: int, to_zone_m: float) -> bool:
    """Whether vehicle v can come to a stand where it does not bar the crossing zone z."""
    rest, speed = to_zone_m + _NOSE_M, fleet.speed_mps[v]
    return bool(roads.zone.kind[z] == CROSSING and speed * speed < 2.0 * _HARD_BRAKING_MPS2 * rest)


@compiled
def _must_wait(
    requests: Requests,
    roads: Roads,
    drivers: Drivers,
    fleet: Fleet,
    count: int,
    v: int,
    slot: int,
    z: int,
    to_zone_m: float,
    passes: int,
) -> bool:
    """Whether vehicle v, its front `to_zone_m` before zone z, must stop for a holder of the other lane.

    Behind the zone's edge it stops for egos that drive alone, and not for those that it `passes`: a bit each.
    """
    other = roads.zone.other[z]
    for index in range(requests.holder_first[other], requests.holder_first[other + 1]):
        h, h_slot = requests.holder[index] // HELD, requests.holder[index] % HELD
        if h == v:
            continue
        if fleet.is_ego[h]:
            if (passes >> (h - count)) & 1 or (to_zone_m < 0.0 and fleet.speed_mps[h] < STANDING_MPS):
                continue
        elif to_zone_m < 0.0:
            continue
        h_front = fleet.held_front_m[h, h_slot]
        if h_front - drivers.length_m[h] > roads.zone.other_leave_m[z]:
            continue
        if h_front > roads.zone.other_enter_m[z]:
            # A vehicle that merges into the same lane is followed, not waited for.
            if roads.zone.kind[z] != MERGING:
                return True
            continue
        if fleet.held_ticket[h, h_slot] > fleet.held_ticket[v, slot]:
            continue
        if fleet.goes_first_s[v] > 0.0 and fleet.speed_mps[h] < STANDING_MPS:
            continue
        ahead = to_zone_m - roads.zone.enter_m[z]
        if not is_conflict_free(roads, drivers, fleet, v, ahead, z, h, h_front, 0.4):
            return True
    return False


@compiled
def release_passed(roads: Roads, drivers: Drivers, fleet: Fleet, count: int) -> None:
    """Give up held lanes that the tail has left, and those no longer in the plan.

    Writes `fleet.held_lane`, (N + C, HELD), for the first `count` vehicles.
    """
    for v in range(count):
        for slot in range(HELD):
            lane = fleet.held_lane[v, slot]
            if lane < 0:
                continue
            front = fleet.held_front_m[v, slot]
            gone = front - drivers.length_m[v] > roads.lane.length_m[lane]
            if not gone and front < 0.0:
                gone = True
                for hop in range(PLAN):
                    gone = gone and fleet.plan[v, hop] != lane
            if gone:
                fleet.held_lane[v, slot] = -1
