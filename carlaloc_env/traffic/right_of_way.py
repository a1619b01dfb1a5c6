"""Who may enter a junction, and who waits for whom inside.

A vehicle is admitted to the lanes through a junction when its light and signs permit, those before
it have been admitted, the lane behind the junction has room for it, and every zone that its way
shares with somebody admitted earlier will be clear in time. Inside, it stops before a zone that is
not clear after all. Zones are given up one by one, as the vehicle's tail leaves them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.compiled import compiled
from carlaloc_env.traffic.car_following import COMFORT_BRAKING_MPS2
from carlaloc_env.traffic.columns import Array, Index, columns
from carlaloc_env.traffic.dice import chance
from carlaloc_env.traffic.junctions import MERGING, PARTING
from carlaloc_env.traffic.leaders import first_on
from carlaloc_env.traffic.presence import Presence
from carlaloc_env.traffic.roads import Roads
from carlaloc_env.traffic.state import (
    HELD,
    PLAN,
    REFUSED_LEADER,
    REFUSED_LIGHT,
    REFUSED_ROOM,
    REFUSED_ZONE,
    Drivers,
    Fleet,
    Habits,
)

GREEN, YELLOW = 3, 2
YELLOW_BRAKING_MPS2 = 3.0
"""At yellow, drivers stop if that takes less braking [m/s²]."""
STOP_SIGN_S = 1.0
"""How long they stand at a stop sign [s]."""
PATIENCE_S = 25.0
"""After so long a wait, a driver's turn comes before that of higher ranks [s]."""
STANDING_MPS = 0.1
_STANDING_INSIDE_S = 8.0
_GAP_S, _SHORTEST_GAP_S = 1.8, 0.8
_BEFORE_ZONE_M = 0.6
_ROOM_M = 1.5
_PULL_AWAY_MPS2, _INSIDE_MPS = 1.3, 8.0
_MAX_WAITING = 512
_STUCK_OUTSIDE_S, _STUCK_OUTSIDE_M = 3.0, 2.0
_AT_SIGN_M, _AT_LINE_M = 3.0, 8.0
_RING_S, _LONGEST_RING = 6.0, 24
_LIGHTS, _SIGNS = 23, 24


class Asks:
    """Vehicles that come up to a junction and want in."""

    vehicle: Index
    """(W,)."""
    hop: Index
    """Place of the first junction lane in the vehicle's plan, (W,)."""
    distance_m: Array
    """From its front to that lane [m], (W,)."""
    urgency: Array
    """The greater goes first, (W,)."""


class Requests(NamedTuple):
    """Who wants in, and who has been admitted to which lane."""

    ask: Asks
    """The first ``used[0]`` rows are in use."""
    holder_first: Index
    """Rows of `holder` for each lane, (N + 1,)."""
    holder: Index
    """Vehicle · HELD + place in its list of held lanes, (N · HELD,)."""
    claimed: Array
    """Room claimed on each lane by those admitted to a junction before it [m], (N,)."""
    used: Index
    """Requests in use, and the number of the next ticket, (2,)."""


def empty_requests(vehicles: int, lanes: int) -> Requests:
    """Room for the requests of a number of vehicles and the ego."""
    return Requests(
        ask=columns(Asks, _MAX_WAITING),
        holder_first=np.zeros(lanes + 1, np.int64),
        holder=np.zeros((vehicles + 1) * HELD, np.int64),
        claimed=np.zeros(lanes),
        used=np.zeros(2, np.int64),
    )


@compiled
def list_holders(asks: Requests, fleet: Fleet) -> None:
    """Sort everybody who has been admitted by lane."""
    first = asks.holder_first
    first[:] = 0
    rows, places = fleet.held_lane.shape
    for v in range(rows):
        for k in range(places):
            if fleet.held_lane[v, k] >= 0:
                first[fleet.held_lane[v, k] + 1] += 1
    for lane in range(len(first) - 1):
        first[lane + 1] += first[lane]
    for v in range(rows - 1, -1, -1):
        for k in range(places - 1, -1, -1):
            lane = fleet.held_lane[v, k]
            if lane >= 0:
                first[lane + 1] -= 1
                asks.holder[first[lane + 1]] = v * HELD + k
    total = 0
    for v in range(rows):
        for k in range(places):
            total += fleet.held_lane[v, k] >= 0
    for lane in range(len(first) - 1):
        first[lane] = first[lane + 1]
    first[len(first) - 1] = total


@compiled
def travel_time(distance_m: float, speed_mps: float, acceleration_mps2: float, top_mps: float) -> float:
    """Time to cover a distance while gaining speed up to a top speed [s], 0 for what lies behind."""
    if distance_m <= 0.0:
        return 0.0
    top = max(top_mps, speed_mps, 0.1)
    gain = (top * top - speed_mps * speed_mps) / (2.0 * acceleration_mps2)
    if distance_m <= gain:
        return float(
            (np.sqrt(speed_mps * speed_mps + 2.0 * acceleration_mps2 * distance_m) - speed_mps)
            / acceleration_mps2
        )
    return float((top - speed_mps) / acceleration_mps2 + (distance_m - gain) / top)


@compiled
def holds(fleet: Fleet, v: int, lane: int) -> bool:
    """Whether a vehicle has been admitted to a lane."""
    found = False
    for k in range(HELD):
        found = found or fleet.held_lane[v, k] == lane
    return found


@compiled
def drop_holds_ahead(fleet: Fleet, v: int) -> None:
    """Give up all lanes that the vehicle has not entered."""
    for k in range(HELD):
        if fleet.held_lane[v, k] >= 0 and fleet.held_front_m[v, k] < 0.0:
            fleet.held_lane[v, k] = -1


@compiled
def permitted(
    roads: Roads, lane: int, signals: NDArray[np.uint8], to_line_m: float, speed_mps: float
) -> bool:
    """Whether the lights before a junction lane let a vehicle go that far before its line [m]."""
    if to_line_m < -1.0:
        return True
    lit, yellow = False, False
    for k in range(roads.lane.head_first[lane], roads.lane.head_end[lane]):
        state = signals[roads.head[k]]
        if state == GREEN:
            return True
        lit = lit or state > 0
        yellow = yellow or state == YELLOW
    if not lit:
        return True
    return bool(yellow and speed_mps * speed_mps / (2.0 * max(to_line_m, 0.1)) > YELLOW_BRAKING_MPS2)


@compiled
def collect(
    asks: Requests,
    roads: Roads,
    drivers: Drivers,
    fleet: Fleet,
    habits: Habits,
    signals: NDArray[np.uint8],
    count: int,
) -> None:
    """Find all who want in, and where they must stop if they may not; `fleet.stop_gap_m` says where."""
    asks.used[0] = 0
    for v in range(count):
        fleet.stop_gap_m[v] = np.inf
        fleet.at_stop_sign[v] = False
        fleet.refused[v], fleet.blocker[v] = 0, -1
        front = fleet.station_m[v] + 0.5 * drivers.length_m[v]
        speed = fleet.speed_mps[v]
        reach = max(30.0, speed * speed / (2.0 * COMFORT_BRAKING_MPS2) + 12.0)
        lane = fleet.plan[v, 0]
        distance = roads.lane.length_m[lane] - front
        for hop in range(1, PLAN):
            if distance > reach:
                break
            lane = fleet.plan[v, hop]
            if lane < 0:
                ending = fleet.plan[v, hop - 1]
                # Who has not reached its lane yet waits for it behind the stop line, too.
                halt = min(roads.lane.wide_m[ending], roads.lane.stop_m[ending] + 1.0)
                narrow = roads.lane.length_m[ending] - halt
                fleet.stop_gap_m[v] = max(distance - 1.0 - narrow, 0.0)
                break
            before = fleet.plan[v, hop - 1]
            if roads.lane.junction[lane] >= 0 and roads.lane.junction[before] < 0:
                _ask(asks, roads, fleet, habits, signals, v, hop, distance)
                if not holds(fleet, v, lane):
                    break
            distance += roads.lane.length_m[lane]
    _sort_requests(asks, roads, fleet)


@compiled
def _ignores(share: float, seed: int, purpose: int, fleet: Fleet, v: int) -> bool:
    """Whether a driver pays no heed this time; drawn once for each junction that it comes to."""
    return share > 0.0 and chance(seed, purpose, v, fleet.draws[v]) < share


@compiled
def _ask(
    asks: Requests,
    roads: Roads,
    fleet: Fleet,
    habits: Habits,
    signals: NDArray[np.uint8],
    v: int,
    hop: int,
    distance_m: float,
) -> None:
    lane, before = fleet.plan[v, hop], fleet.plan[v, hop - 1]
    to_line = distance_m - (roads.lane.length_m[before] - roads.lane.stop_m[before])
    ready = permitted(roads, lane, signals, to_line, fleet.speed_mps[v])
    if not ready and _ignores(habits.ignore_lights, habits.seed, _LIGHTS, fleet, v):
        ready = True
    if holds(fleet, v, lane):
        stuck = fleet.waited_s[v] > _STUCK_OUTSIDE_S and distance_m > _STUCK_OUTSIDE_M
        speed = fleet.speed_mps[v]
        too_late = to_line < -1.0 or speed * speed > 2.0 * YELLOW_BRAKING_MPS2 * max(to_line, 0.05)
        if (ready or too_late) and not stuck:
            return
        drop_holds_ahead(fleet, v)
    gap = to_line if to_line > -1.0 else max(distance_m - 0.3, 0.0)
    fleet.stop_gap_m[v] = min(fleet.stop_gap_m[v], max(gap, 0.0))
    if roads.lane.stop_sign[lane] and not _ignores(habits.ignore_signs, habits.seed, _SIGNS, fleet, v):
        fleet.at_stop_sign[v] = to_line < _AT_SIGN_M
        ready = ready and fleet.stopped_s[v] >= STOP_SIGN_S
    fleet.refused[v] = REFUSED_LIGHT
    if ready and asks.used[0] < _MAX_WAITING:
        k = asks.used[0]
        asks.ask.vehicle[k], asks.ask.hop[k], asks.ask.distance_m[k] = v, hop, distance_m
        asks.used[0] = k + 1


@compiled
def _sort_requests(asks: Requests, roads: Roads, fleet: Fleet) -> None:
    """Order of decision: patience at its end, then rank, then who is there first, then the number."""
    for k in range(asks.used[0]):
        v = asks.ask.vehicle[k]
        lane = fleet.plan[v, asks.ask.hop[k]]
        waited = fleet.waited_s[v]
        arrives = asks.ask.distance_m[k] / max(fleet.speed_mps[v], 1.0)
        rank = 10.0 if waited > PATIENCE_S and asks.ask.distance_m[k] < 8.0 else float(roads.lane.rank[lane])
        asks.ask.urgency[k] = 1000.0 * rank + waited - arrives
    for k in range(1, asks.used[0]):
        v, hop, distance, urgency = (
            asks.ask.vehicle[k],
            asks.ask.hop[k],
            asks.ask.distance_m[k],
            asks.ask.urgency[k],
        )
        j = k
        while j > 0 and asks.ask.urgency[j - 1] < urgency:
            asks.ask.vehicle[j], asks.ask.hop[j] = asks.ask.vehicle[j - 1], asks.ask.hop[j - 1]
            asks.ask.distance_m[j], asks.ask.urgency[j] = asks.ask.distance_m[j - 1], asks.ask.urgency[j - 1]
            j -= 1
        asks.ask.vehicle[j], asks.ask.hop[j], asks.ask.distance_m[j], asks.ask.urgency[j] = (
            v,
            hop,
            distance,
            urgency,
        )


@compiled
def admit(asks: Requests, there: Presence, roads: Roads, drivers: Drivers, fleet: Fleet) -> None:
    """Grant what can be granted, in order; those admitted lose their place to stop."""
    _claim_rooms(asks, roads, drivers, fleet)
    for k in range(_MAX_WAITING):
        if k >= asks.used[0]:
            break
        v, hop = asks.ask.vehicle[k], asks.ask.hop[k]
        if _leader_waits(roads, fleet, v, fleet.plan[v, hop], asks.ask.distance_m[k]):
            fleet.refused[v] = REFUSED_LEADER
            continue
        patient = fleet.waited_s[v] > PATIENCE_S and asks.ask.distance_m[k] < _AT_LINE_M
        if not _has_room(asks, there, roads, drivers, fleet, v, hop) and not _waits_in_a_ring(fleet, v):
            fleet.refused[v] = REFUSED_ROOM
            continue
        if _zones_clear(asks, roads, drivers, fleet, v, hop, asks.ask.distance_m[k]):
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
def _claim_rooms(asks: Requests, roads: Roads, drivers: Drivers, fleet: Fleet) -> None:
    asks.claimed[:] = 0.0
    for v in range(len(fleet.speed_mps) - 1):
        for k in range(HELD):
            lane = fleet.held_lane[v, k]
            if lane >= 0 and fleet.held_front_m[v, k] < roads.lane.length_m[lane]:
                _claim(asks, drivers, fleet, v, lane)


@compiled
def _claim(asks: Requests, drivers: Drivers, fleet: Fleet, v: int, lane: int) -> None:
    for hop in range(PLAN - 1):
        if fleet.plan[v, hop] == lane and fleet.plan[v, hop + 1] >= 0:
            asks.claimed[fleet.plan[v, hop + 1]] += drivers.length_m[v] + 2.0
            return


@compiled
def _has_room(
    asks: Requests, there: Presence, roads: Roads, drivers: Drivers, fleet: Fleet, v: int, hop: int
) -> bool:
    """Whether the lanes behind the junction can take the vehicle as a whole."""
    need = drivers.length_m[v] + drivers.standstill_m[v] + _ROOM_M
    free = 0.0
    for k in range(hop + 1, PLAN):
        lane = fleet.plan[v, k]
        if lane < 0:
            return True
        if roads.lane.junction[lane] >= 0 and k == hop + 1:
            hop += 1
            continue
        row = first_on(there, lane, there.first[lane], v)
        free -= asks.claimed[lane]
        if row >= 0:
            rear = there.body.centre_m[row] - there.body.half_m[row]
            speed = there.body.speed_mps[row]
            fleet.blocker[v] = there.body.owner[row]
            return bool(free + rear + min(speed * speed / 4.0, 3.0 * speed) >= need)
        free += roads.lane.length_m[lane]
        if free >= need:
            return True
    return True


@compiled
def _zones_clear(
    asks: Requests,
    roads: Roads,
    drivers: Drivers,
    fleet: Fleet,
    v: int,
    hop: int,
    distance_m: float,
) -> bool:
    """Whether every zone on the way is clear when the vehicle would be there."""
    waited = fleet.waited_s[v]
    margin = max(_SHORTEST_GAP_S, _GAP_S - 0.05 * waited)
    ahead = distance_m
    for k in range(hop, PLAN):
        lane = fleet.plan[v, k]
        if lane < 0 or roads.lane.junction[lane] < 0:
            return True
        for z in range(roads.lane.zone_first[lane], roads.lane.zone_end[lane]):
            if roads.zone.kind[z] == PARTING:
                continue
            other = roads.zone.other[z]
            for place in range(asks.holder_first[other], asks.holder_first[other + 1]):
                h, slot = asks.holder[place] // HELD, asks.holder[place] % HELD
                if h == v or fleet.held_lane[h, slot] != other:
                    continue
                if not _agree(roads, drivers, fleet, v, ahead, z, h, fleet.held_front_m[h, slot], margin):
                    return False
        ahead += roads.lane.length_m[lane]
    return True


@compiled
def _agree(
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
    """Whether v would come to zone z well after holder h has left it, or leave it well before h comes."""
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


@compiled
def wait_inside(asks: Requests, roads: Roads, drivers: Drivers, fleet: Fleet, count: int) -> None:
    """Stop before zones on one's way that somebody admitted earlier, or somebody standing there, holds."""
    for v in range(count):
        for slot in range(HELD):
            lane = fleet.held_lane[v, slot]
            if lane < 0:
                continue
            front = fleet.held_front_m[v, slot]
            for z in range(roads.lane.zone_first[lane], roads.lane.zone_end[lane]):
                to_zone = roads.zone.enter_m[z] - front
                if roads.zone.kind[z] == PARTING or to_zone < 0.0:
                    continue
                if _must_wait(asks, roads, drivers, fleet, v, slot, z, to_zone):
                    gap = max(to_zone - _BEFORE_ZONE_M, 0.0)
                    fleet.stop_gap_m[v] = min(fleet.stop_gap_m[v], gap)


@compiled
def _must_wait(
    asks: Requests, roads: Roads, drivers: Drivers, fleet: Fleet, v: int, slot: int, z: int, to_zone_m: float
) -> bool:
    other = roads.zone.other[z]
    for place in range(asks.holder_first[other], asks.holder_first[other + 1]):
        h, h_slot = asks.holder[place] // HELD, asks.holder[place] % HELD
        if h == v:
            continue
        h_front = fleet.held_front_m[h, h_slot]
        if h_front - drivers.length_m[h] > roads.zone.other_leave_m[z]:
            continue
        inside = h_front > roads.zone.other_enter_m[z]
        if inside:
            # Who merges into the same lane is followed, not waited for.
            if roads.zone.kind[z] != MERGING:
                return True
            continue
        if fleet.held_ticket[h, h_slot] > fleet.held_ticket[v, slot]:
            continue
        if fleet.waited_s[v] > _STANDING_INSIDE_S and fleet.speed_mps[h] < STANDING_MPS:
            continue
        ahead = to_zone_m - roads.zone.enter_m[z]
        if not _agree(roads, drivers, fleet, v, ahead, z, h, h_front, 0.4):
            return True
    return False


@compiled
def release_passed(roads: Roads, drivers: Drivers, fleet: Fleet, count: int) -> None:
    """Give up lanes that the tail has left, and lanes that are no longer in the plan."""
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
                    if fleet.plan[v, hop] == lane:
                        gone = False
                        break
            if gone:
                fleet.held_lane[v, slot] = -1
