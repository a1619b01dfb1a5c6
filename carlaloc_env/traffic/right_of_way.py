"""Right of way: the vehicles that may enter a junction, and those that wait before it.

A vehicle is admitted when its light and signs permit, those before it have been admitted, the lane behind the
junction has room for it, and every zone that its path shares with a vehicle admitted earlier will be clear in
time. Inside, it stops before a zone that is not clear after all; zones are given up as its tail leaves them.
"""

import numpy as np

from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.conflict_times import zones_clear
from carlaloc_env.traffic.exit_clearance import claim_rooms, has_room
from carlaloc_env.traffic.junction_requests import PATIENCE_S
from carlaloc_env.traffic.tables.conflict_zones import PARTING
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.occupancy import Occupancy
from carlaloc_env.traffic.tables.request_queue import (
    Requests,
    list_holders,
    swap_requests,
)
from carlaloc_env.traffic.tables.vehicle_state import (
    HELD,
    PLAN,
    REFUSED_LEADER,
    REFUSED_LIGHT,
    REFUSED_ROOM,
    REFUSED_ZONE,
    Drivers,
    Fleet,
)

_RING_S = 6.0
"""Each vehicle in a ring of waiting vehicles has waited for at least so long [s]."""
_LONGEST_RING = 24
"""Vehicles that such a ring has at most."""
_AT_LINE_M = 8.0
"""Distance to the junction within which patience counts [m]."""


@compiled
def admit(requests: Requests, occupancy: Occupancy, roads: Roads, drivers: Drivers, fleet: Fleet) -> None:
    """Grant requests in order where leaders, room and zones allow.

    Those admitted hold their junction lanes (`fleet.held_lane`, `held_front_m` [m], `held_ticket`, each
    (N + C, HELD)) and need not stop; `fleet.refused` has the reason why others are not, (N + C,).
    """
    claim_rooms(requests, roads, drivers, fleet)
    for k in range(len(requests.queue.vehicle)):
        if k >= requests.used[0]:
            break
        v, hop, distance = requests.queue.vehicle[k], requests.queue.hop[k], requests.queue.distance_m[k]
        if _leader_waits(roads, fleet, v, fleet.plan[v, hop], distance):
            fleet.refused[v] = REFUSED_LEADER
            continue
        has_exit = has_room(requests, occupancy, roads, drivers, fleet, v, hop)
        if not has_exit and not _waits_in_a_ring(fleet, v):
            fleet.refused[v] = REFUSED_ROOM
            continue
        if zones_clear(requests, roads, drivers, fleet, v, hop, distance):
            _grant(requests, roads, drivers, fleet, v, hop, distance)
            fleet.refused[v] = 0
            continue
        fleet.refused[v] = REFUSED_ZONE
        if fleet.waited_s[v] > PATIENCE_S and distance < _AT_LINE_M:
            _keep_free(requests, roads, fleet, k, hop)


@compiled
def _waits_in_a_ring(fleet: Fleet, v: int) -> bool:
    """Whether vehicle v waits for room in a ring of vehicles that wait for each other."""
    other = v
    for _ in range(_LONGEST_RING):
        if fleet.waited_s[other] < _RING_S:
            return False
        if fleet.refused[other] == REFUSED_ROOM or other == v:
            other = fleet.blocker[other]
        elif fleet.refused[other] == REFUSED_LIGHT:
            return False
        else:
            other = fleet.leader[other]
        if other == v:
            return True
        if other < v or fleet.is_ego[other]:
            return False
    return False


@compiled
def _keep_free(requests: Requests, roads: Roads, fleet: Fleet, k: int, hop: int) -> None:
    """Drop all requests after request k whose paths cross that of its vehicle, which has waited long."""
    v = requests.queue.vehicle[k]
    kept = k + 1
    for j in range(k + 1, requests.used[0]):
        other = fleet.plan[requests.queue.vehicle[j], requests.queue.hop[j]]
        meets = False
        lane = fleet.plan[v, hop]
        for z in range(roads.lane.zone_first[lane], roads.lane.zone_end[lane]):
            if roads.zone.other[z] == other and roads.zone.kind[z] != PARTING:
                meets = True
        if not meets:
            swap_requests(requests.queue, kept, j)
            kept += 1
    requests.used[0] = kept


@compiled
def _leader_waits(roads: Roads, fleet: Fleet, v: int, lane: int, distance_m: float) -> bool:
    """Whether the vehicle before it stands between it and the junction, and has not been admitted there."""
    leader = fleet.leader[v]
    if leader < 0 or fleet.gap_m[v] > distance_m:
        return False
    if fleet.is_ego[leader]:
        return True
    here = roads.lane.junction[lane]
    if roads.lane.junction[fleet.plan[leader, 0]] == here:
        return False
    for k in range(HELD):
        held = fleet.held_lane[leader, k]
        if held >= 0 and roads.lane.junction[held] == here:
            return False
    return True


@compiled
def _grant(
    requests: Requests, roads: Roads, drivers: Drivers, fleet: Fleet, v: int, hop: int, distance_m: float
) -> None:
    """Admit a vehicle to all lanes of one junction that follow each other in its plan."""
    ahead = distance_m
    requests.used[1] += 1
    for k in range(hop, PLAN):
        lane = fleet.plan[v, k]
        if lane < 0 or roads.lane.junction[lane] < 0:
            break
        for slot in range(HELD):
            if fleet.held_lane[v, slot] < 0:
                fleet.held_lane[v, slot] = lane
                fleet.held_front_m[v, slot] = -ahead
                fleet.held_ticket[v, slot] = requests.used[1]
                break
        ahead += roads.lane.length_m[lane]
        if k + 1 < PLAN and fleet.plan[v, k + 1] >= 0:
            requests.claimed[fleet.plan[v, k + 1]] += drivers.length_m[v] + 2.0
    fleet.stop_gap_m[v] = np.inf
    list_holders(requests, fleet)
