"""Conflict times: when two vehicles would be in a zone that their lanes share."""

import numpy as np

from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.conflict_zones import MERGING, PARTING
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.request_queue import Requests
from carlaloc_env.traffic.tables.vehicle_state import (
    HELD,
    PLAN,
    Drivers,
    Fleet,
)

_GAP_S = 1.8
"""Time that drivers leave between themselves and others in a zone at first [s]."""
_SHORTEST_GAP_S = 0.8
"""Least such time, after a long wait [s]."""
_PULL_AWAY_MPS2 = 1.3
"""Acceleration that others are taken to have inside a junction [m/s²]."""
_INSIDE_MPS = 8.0
"""Speed that others are taken to attain inside a junction [m/s]."""


@compiled
def travel_time(distance_m: float, speed_mps: float, acceleration_mps2: float, top_mps: float) -> float:
    """Time to cover a distance from a speed at constant acceleration up to a top speed [s], 0 behind.

    Args:
        distance_m: Distance [m].
        speed_mps: Speed at its beginning [m/s].
        acceleration_mps2: Acceleration below the top speed [m/s²].
        top_mps: Top speed [m/s].
    """
    if distance_m <= 0.0:
        return 0.0
    top = max(top_mps, speed_mps, 0.1)
    gain = (top * top - speed_mps * speed_mps) / (2.0 * acceleration_mps2)
    if distance_m <= gain:
        end_mps = np.sqrt(speed_mps * speed_mps + 2.0 * acceleration_mps2 * distance_m)
        return float((end_mps - speed_mps) / acceleration_mps2)
    return float((top - speed_mps) / acceleration_mps2 + (distance_m - gain) / top)


@compiled
def zones_clear(
    requests: Requests, roads: Roads, drivers: Drivers, fleet: Fleet, v: int, hop: int, distance_m: float
) -> bool:
    """Whether every zone on the path of vehicle v is clear when it would be there.

    Args:
        requests: Holders of all lanes.
        roads: The roads.
        drivers: Drivers, (N + C,).
        fleet: State, (N + C,).
        v: The vehicle.
        hop: Index in its plan of the first junction lane.
        distance_m: From its front to that lane [m].
    """
    margin = max(_SHORTEST_GAP_S, _GAP_S - 0.05 * fleet.waited_s[v])
    ahead = distance_m
    for k in range(hop, PLAN):
        lane = fleet.plan[v, k]
        if lane < 0 or roads.lane.junction[lane] < 0:
            return True
        for z in range(roads.lane.zone_first[lane], roads.lane.zone_end[lane]):
            if roads.zone.kind[z] == PARTING:
                continue
            other = roads.zone.other[z]
            for index in range(requests.holder_first[other], requests.holder_first[other + 1]):
                h, slot = requests.holder[index] // HELD, requests.holder[index] % HELD
                if h == v or fleet.held_lane[h, slot] != other:
                    continue
                front = fleet.held_front_m[h, slot]
                if not is_conflict_free(roads, drivers, fleet, v, ahead, z, h, front, margin):
                    return False
        ahead += roads.lane.length_m[lane]
    return True


@compiled
def is_conflict_free(
    roads: Roads,
    drivers: Drivers,
    fleet: Fleet,
    v: int,
    ahead_m: float,
    z: int,
    h: int,
    h_front_m: float,
    margin_s: float,
) -> bool:
    """Whether v would come to zone z well after holder h has left it, or leave it well before h comes.

    Args:
        roads: The roads.
        drivers: Drivers, (N + C,).
        fleet: State, (N + C,).
        v: The vehicle that would enter.
        ahead_m: From its front to the beginning of the lane that has the zone [m].
        z: Row of `roads.zone`, as seen from that lane.
        h: The holder.
        h_front_m: Station of its front on the other lane [m].
        margin_s: Time that must lie between the two [s].
    """
    length, h_length = drivers.length_m[v], drivers.length_m[h]
    if h_front_m - h_length > roads.zone.other_leave_m[z]:
        return True
    speed, h_speed = fleet.speed_mps[v], fleet.speed_mps[h]
    to_enter = ahead_m + roads.zone.enter_m[z]
    arrives = travel_time(to_enter, speed, drivers.acceleration_mps2[v], max(_INSIDE_MPS, speed))
    if roads.zone.kind[z] == MERGING:
        h_enters = travel_time(roads.zone.other_enter_m[z] - h_front_m, h_speed, _PULL_AWAY_MPS2, _INSIDE_MPS)
        if h_front_m > roads.zone.other_enter_m[z] or h_enters + 0.8 < arrives:
            return True
    else:
        h_leaves = travel_time(
            roads.zone.other_leave_m[z] + h_length - h_front_m, h_speed, _PULL_AWAY_MPS2, _INSIDE_MPS
        )
        if h_leaves + 0.3 < arrives:
            return True
    h_arrives = travel_time(
        roads.zone.other_enter_m[z] - h_front_m, h_speed, drivers.acceleration_mps2[h], max(12.0, h_speed)
    )
    leaves = travel_time(
        ahead_m + roads.zone.leave_m[z] + length, speed, 0.8 * drivers.acceleration_mps2[v], _INSIDE_MPS
    )
    return bool(leaves + margin_s < h_arrives)
