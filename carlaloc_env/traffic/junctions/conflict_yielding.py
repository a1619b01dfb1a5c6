"""Yielding inside a junction: stop before zones that are not clear, give up zones that lie behind."""

from __future__ import annotations

from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.junctions.conflict_times import is_conflict_free
from carlaloc_env.traffic.tables.conflict_zones import MERGING, PARTING
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.reservations import Requests
from carlaloc_env.traffic.tables.vehicle_state import HELD, PLAN, STANDING_MPS, STEP_S, Drivers, Fleet

_STANDING_INSIDE_S = 8.0
"""A vehicle that has waited longer inside a junction moves on before vehicles that stand [s]."""
_GOES_FIRST_S = 5.0
"""So long it keeps going before them: to have begun is not to be through [s]."""
_BEFORE_ZONE_M = 0.6
"""Gap to a zone before which a vehicle stops [m]."""


@compiled
def wait_inside(requests: Requests, roads: Roads, drivers: Drivers, fleet: Fleet, count: int) -> None:
    """Stop before zones on the path that a vehicle admitted earlier, or one standing there, holds.

    Writes `fleet.stop_gap_m` and `goes_first_s`, each (N + 1,), for the first `count` vehicles.
    """
    for v in range(count):
        if fleet.waited_s[v] > _STANDING_INSIDE_S:
            fleet.goes_first_s[v] = _GOES_FIRST_S
        else:
            fleet.goes_first_s[v] = max(fleet.goes_first_s[v] - STEP_S, 0.0)
        for slot in range(HELD):
            lane = fleet.held_lane[v, slot]
            if lane < 0:
                continue
            front = fleet.held_front_m[v, slot]
            for z in range(roads.lane.zone_first[lane], roads.lane.zone_end[lane]):
                to_zone = roads.zone.enter_m[z] - front
                if roads.zone.kind[z] == PARTING or to_zone < 0.0:
                    continue
                if _must_wait(requests, roads, drivers, fleet, v, slot, z, to_zone):
                    gap = max(to_zone - _BEFORE_ZONE_M, 0.0)
                    fleet.stop_gap_m[v] = min(fleet.stop_gap_m[v], gap)


@compiled
def _must_wait(
    requests: Requests,
    roads: Roads,
    drivers: Drivers,
    fleet: Fleet,
    v: int,
    slot: int,
    z: int,
    to_zone_m: float,
) -> bool:
    """Whether vehicle v, its front `to_zone_m` before zone z, must stop for a holder of the other lane."""
    other = roads.zone.other[z]
    for index in range(requests.holder_first[other], requests.holder_first[other + 1]):
        h, h_slot = requests.holder[index] // HELD, requests.holder[index] % HELD
        if h == v:
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

    Writes `fleet.held_lane`, (N + 1, HELD), for the first `count` vehicles.
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
