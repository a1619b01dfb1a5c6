"""Who may enter a junction, and who waits for whom inside.

A vehicle is admitted to the lanes through a junction when its light and signs permit, those before
it have been admitted, the lane behind the junction has room for it, and every zone that its way
shares with somebody admitted earlier will be clear in time. Inside, it stops before a zone that is
not clear after all. Zones are given up one by one, as the vehicle's tail leaves them.
"""

from __future__ import annotations

import numpy as np

from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.junctions.approach import PATIENCE_S
from carlaloc_env.traffic.junctions.conflict_times import zones_clear
from carlaloc_env.traffic.junctions.exit_clearance import claim_rooms, has_room
from carlaloc_env.traffic.tables.conflict_zones import PARTING
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.occupancy import Presence
from carlaloc_env.traffic.tables.reservations import MAX_WAITING, Requests, list_holders
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

_RING_S, _LONGEST_RING = 6.0, 24
_AT_LINE_M = 8.0


@compiled
def admit(asks: Requests, there: Presence, roads: Roads, drivers: Drivers, fleet: Fleet) -> None:
    """Grant what can be granted, in order; those admitted lose their place to stop."""
    claim_rooms(asks, roads, drivers, fleet)
    for k in range(MAX_WAITING):
        if k >= asks.used[0]:
            break
        v, hop = asks.ask.vehicle[k], asks.ask.hop[k]
        if _leader_waits(roads, fleet, v, fleet.plan[v, hop], asks.ask.distance_m[k]):
            fleet.refused[v] = REFUSED_LEADER
            continue
        patient = fleet.waited_s[v] > PATIENCE_S and asks.ask.distance_m[k] < _AT_LINE_M
        if not has_room(asks, there, roads, drivers, fleet, v, hop) and not _waits_in_a_ring(fleet, v):
            fleet.refused[v] = REFUSED_ROOM
            continue
        if zones_clear(asks, roads, drivers, fleet, v, hop, asks.ask.distance_m[k]):
            _grant(asks, roads, drivers, fleet, v, hop, asks.ask.distance_m[k])
            fleet.refused[v] = 0
            continue
        fleet.refused[v] = REFUSED_ZONE
        if patient:
            _keep_free(asks, roads, fleet, k, hop)


@compiled
def _waits_in_a_ring(fleet: Fleet, v: int) -> bool:
    """Whether a vehicle waits for room that somebody takes who, in the end, waits for its own place."""
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
        if 0 <= other < v:
            return False
        if other < 0 or other == len(fleet.speed_mps) - 1:
            return False
    return False


@compiled
def _keep_free(asks: Requests, roads: Roads, fleet: Fleet, k: int, hop: int) -> None:
    """Turn down everybody after request k whose way crosses that of somebody who has waited long."""
    v = asks.ask.vehicle[k]
    kept = k + 1
    for j in range(k + 1, asks.used[0]):
        other = fleet.plan[asks.ask.vehicle[j], asks.ask.hop[j]]
        meets = False
        lane = fleet.plan[v, hop]
        for z in range(roads.lane.zone_first[lane], roads.lane.zone_end[lane]):
            if roads.zone.other[z] == other and roads.zone.kind[z] != PARTING:
                meets = True
        if not meets:
            asks.ask.vehicle[kept], asks.ask.hop[kept] = asks.ask.vehicle[j], asks.ask.hop[j]
            asks.ask.distance_m[kept], asks.ask.urgency[kept] = asks.ask.distance_m[j], asks.ask.urgency[j]
            kept += 1
    asks.used[0] = kept


@compiled
def _leader_waits(roads: Roads, fleet: Fleet, v: int, lane: int, distance_m: float) -> bool:
    """Whether the vehicle before it stands between it and the junction, and has not been admitted there."""
    leader = fleet.leader[v]
    if leader < 0 or fleet.gap_m[v] > distance_m:
        return False
    if leader == len(fleet.speed_mps) - 1:
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
    asks: Requests, roads: Roads, drivers: Drivers, fleet: Fleet, v: int, hop: int, distance_m: float
) -> None:
    """Admit a vehicle to all lanes of one junction that follow each other in its plan."""
    ahead = distance_m
    asks.used[1] += 1
    for k in range(hop, PLAN):
        lane = fleet.plan[v, k]
        if lane < 0 or roads.lane.junction[lane] < 0:
            break
        for slot in range(HELD):
            if fleet.held_lane[v, slot] < 0:
                fleet.held_lane[v, slot] = lane
                fleet.held_front_m[v, slot] = -ahead
                fleet.held_ticket[v, slot] = asks.used[1]
                break
        ahead += roads.lane.length_m[lane]
        if k + 1 < PLAN and fleet.plan[v, k + 1] >= 0:
            asks.claimed[fleet.plan[v, k + 1]] += drivers.length_m[v] + 2.0
    fleet.stop_gap_m[v] = np.inf
    list_holders(asks, fleet)
