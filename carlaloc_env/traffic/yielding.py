"""Inside a junction: conflict times, yielding, and room behind it.

Conflict times: when two vehicles would be in a zone that their lanes share.

Yielding inside a junction: stop before zones that are not clear, give up zones that lie behind.

Exit clearance: room behind a junction, so that no vehicle comes to a stand inside.
"""

import numpy as np

from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.conflict_zones import CROSSING, MERGING, PARTING
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.occupancy import Occupancy
from carlaloc_env.traffic.tables.vehicle_state import (
    HELD,
    PLAN,
    STANDING_MPS,
    STEP_S,
    Drivers,
    Fleet,
    Requests,
)
from carlaloc_env.traffic.vehicles.ego_agent import EgoBox, passes_ego

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
        drivers: Drivers, (N + 1,).
        fleet: State, (N + 1,).
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
        drivers: Drivers, (N + 1,).
        fleet: State, (N + 1,).
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
    requests: Requests, roads: Roads, drivers: Drivers, fleet: Fleet, ego: EgoBox, count: int
) -> None:
    """Stop before zones on the path that a vehicle admitted earlier, or one standing there, holds.

    Before the ego, whose way on is not known, a vehicle stops at the edge of the first zone, or drives on
    through all. Between them it would stand in the ego's way, and each would wait for the other.

    Writes `fleet.stop_gap_m` and `goes_first_s`, each (N + 1,), for the first `count` vehicles.
    """
    for v in range(count):
        if fleet.waited_s[v] > _STANDING_INSIDE_S:
            fleet.goes_first_s[v] = _GOES_FIRST_S
        else:
            fleet.goes_first_s[v] = max(fleet.goes_first_s[v] - STEP_S, 0.0)
        passes = _passes_ego(roads, drivers, fleet, ego, v)
        for slot in range(HELD):
            lane = fleet.held_lane[v, slot]
            if lane < 0:
                continue
            front = fleet.held_front_m[v, slot]
            for z in range(roads.lane.zone_first[lane], roads.lane.zone_end[lane]):
                to_zone = roads.zone.enter_m[z] - front
                at_edge = fleet.speed_mps[-1] >= STANDING_MPS and _halts_at_edge(roads, fleet, v, z, to_zone)
                if roads.zone.kind[z] == PARTING or (to_zone < 0.0 and not at_edge):
                    continue
                if _must_wait(requests, roads, drivers, fleet, v, slot, z, to_zone, passes):
                    gap = max(to_zone - _BEFORE_ZONE_M, 0.0)
                    fleet.stop_gap_m[v] = min(fleet.stop_gap_m[v], gap)


@compiled
def _passes_ego(roads: Roads, drivers: Drivers, fleet: Fleet, ego: EgoBox, v: int) -> bool:
    """Whether vehicle v can no longer stop before zones of the ego, and the ego has room to brake.

    If the ego stands in such a zone, the way past it must be clear.
    """
    bars, ego_gap_m, way_m = False, np.inf, 0.0
    for slot in range(HELD):
        lane, front = fleet.held_lane[v, slot], fleet.held_front_m[v, slot]
        if lane < 0:
            continue
        for z in range(roads.lane.zone_first[lane], roads.lane.zone_end[lane]):
            way = roads.zone.leave_m[z] + drivers.length_m[v] - front
            if roads.zone.kind[z] != CROSSING or way < 0.0:
                continue
            for k in range(HELD):
                if fleet.held_lane[-1, k] == roads.zone.other[z]:
                    bars = bars or not _halts_at_edge(roads, fleet, v, z, roads.zone.enter_m[z] - front)
                    ego_gap_m = min(ego_gap_m, roads.zone.other_enter_m[z] - fleet.held_front_m[-1, k])
                    way_m = max(way_m, way)
    if not bars or ego.speed_mps * ego.speed_mps < 2.0 * _EGO_BRAKING_MPS2 * ego_gap_m:
        return bars
    return ego.speed_mps < STANDING_MPS and passes_ego(roads, drivers, fleet, ego, v, way_m)


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
    v: int,
    slot: int,
    z: int,
    to_zone_m: float,
    passes: bool,
) -> bool:
    """Whether vehicle v, its front `to_zone_m` before zone z, must stop for a holder of the other lane.

    Behind the zone's edge it stops for the ego alone, and not if it `passes`.
    """
    other, me = roads.zone.other[z], len(fleet.speed_mps) - 1
    for index in range(requests.holder_first[other], requests.holder_first[other + 1]):
        h, h_slot = requests.holder[index] // HELD, requests.holder[index] % HELD
        if h == v or (passes if h == me else to_zone_m < 0.0):
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


_ROOM_M = 1.5
"""Room that a vehicle needs behind a junction beside its length and standstill gap [m]."""
_SLOW_MPS = 2.0
"""Slower than this, the vehicle ahead counts as standing [m/s]."""
_GAP_M = 2.0
"""Gap between vehicles that close up [m]."""


@compiled
def claim_rooms(requests: Requests, roads: Roads, drivers: Drivers, fleet: Fleet) -> None:
    """Claim the room [m] of all vehicles admitted and not yet through; writes `claimed`, (lanes,)."""
    requests.claimed[:] = 0.0
    for v in range(len(fleet.speed_mps) - 1):
        for k in range(HELD):
            lane = fleet.held_lane[v, k]
            if lane >= 0 and fleet.held_front_m[v, k] < roads.lane.length_m[lane]:
                claim_room(requests, drivers, fleet, v, lane)


@compiled
def claim_room(requests: Requests, drivers: Drivers, fleet: Fleet, v: int, lane: int) -> None:
    """Claim room [m] for vehicle v on the lane that follows a junction lane in its plan; writes `claimed`."""
    for hop in range(PLAN - 1):
        if fleet.plan[v, hop] == lane and fleet.plan[v, hop + 1] >= 0:
            requests.claimed[fleet.plan[v, hop + 1]] += drivers.length_m[v] + 2.0
            return


@compiled
def has_room(
    requests: Requests, occupancy: Occupancy, roads: Roads, drivers: Drivers, fleet: Fleet, v: int, hop: int
) -> bool:
    """Whether the lanes behind the junction can take the vehicle as a whole, whichever vehicle stops there.

    Each vehicle on those lanes that has not been admitted to the next junction is taken to close up behind
    the first that stands, or at the next stop line; so are those admitted before.
    """
    need = drivers.length_m[v] + drivers.standstill_m[v] + _ROOM_M
    free = 0.0
    for k in range(hop + 1, PLAN):
        lane = fleet.plan[v, k]
        if lane < 0:
            return True
        if roads.lane.junction[lane] >= 0 and k == hop + 1:
            hop += 1
            continue
        free -= requests.claimed[lane]
        for index in range(occupancy.first[lane], occupancy.first[lane + 1]):
            row = occupancy.order[index]
            other = occupancy.body.owner[row]
            if other == v:
                continue
            fleet.blocker[v] = other
            if occupancy.body.speed_mps[row] < _SLOW_MPS:
                return bool(free + occupancy.body.centre_m[row] - occupancy.body.half_m[row] >= need)
            if not _moves_on(roads, fleet, other):
                free -= 2.0 * occupancy.body.half_m[row] + _GAP_M
        following = fleet.plan[v, k + 1] if k + 1 < PLAN else -1
        ends = following >= 0 and roads.lane.junction[following] >= 0
        if ends and roads.lane.junction[lane] < 0 and roads.lane.stop_m[lane] >= need:
            return bool(free + roads.lane.stop_m[lane] >= need)
        free += roads.lane.length_m[lane]
        if free >= need:
            return True
    return True


@compiled
def _moves_on(roads: Roads, fleet: Fleet, v: int) -> bool:
    """Whether a vehicle has been admitted to the junction ahead of it."""
    for k in range(HELD):
        held = fleet.held_lane[v, k]
        if held >= 0 and fleet.held_front_m[v, k] < 0.0 and roads.lane.junction[held] >= 0:
            return True
    return False
