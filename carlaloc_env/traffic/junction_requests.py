"""Requests to enter junctions: lights and signs on the approach, and the order of urgency."""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.lane_tables import COMFORT_BRAKING_MPS2, Roads
from carlaloc_env.traffic.tables.request_queue import (
    Requests,
    drop_holds_ahead,
    holds,
    swap_requests,
)
from carlaloc_env.traffic.tables.uniform_draws import happens
from carlaloc_env.traffic.tables.vehicle_state import (
    PLAN,
    REFUSED_LIGHT,
    DriverParameters,
    Drivers,
    Fleet,
)

GREEN = 3
"""State of a head, as in `SignalState`."""
YELLOW = 2
"""State of a head, as in `SignalState`."""
YELLOW_BRAKING_MPS2 = 3.0
"""At yellow, drivers stop if that takes less braking [m/s²]."""
HARDEST_BRAKING_MPS2 = 6.0
"""At yellow, drivers who would come to the line too late brake up to this [m/s²]."""
STOP_SIGN_S = 1.0
"""Time that drivers stand at a stop sign [s]."""
PATIENCE_S = 25.0
"""After so long a wait, a driver's turn comes before that of higher ranks [s]."""
_LATE_S = 0.4
"""A front may cross the line so long after the light has turned red [s]."""
_CLOSES_M = 0.6
"""A lane that is too narrow for longer than this before its end closes there [m]."""
_STUCK_OUTSIDE_S = 3.0
"""A vehicle admitted that stands longer before the junction gives its admission up [s]."""
_STUCK_OUTSIDE_M = 2.0
"""Distance before the junction from which that applies [m]."""
_AT_SIGN_M = 3.0
"""Distance to the line within which a driver stands at a stop sign [m]."""
_DRAW_LIGHTS = 23
"""Purpose of the draw for ignored lights."""
_DRAW_SIGNS = 24
"""Purpose of the draw for ignored signs."""


@compiled
def permitted(
    roads: Roads, lane: int, signals: NDArray[np.uint8], red_in_s: Array, to_line_m: float, speed_mps: float
) -> bool:
    """Whether the lights before a junction lane let a vehicle go that far before its line [m].

    At yellow, who can stop in comfort does; so does who would come too late, unless it would have to
    brake too hard.
    """
    if to_line_m < -1.0:
        return True
    lit, left_s = False, 0.0
    for k in range(roads.lane.head_first[lane], roads.lane.head_end[lane]):
        head = roads.head[k]
        if signals[head] == GREEN:
            return True
        lit = lit or signals[head] > 0
        if signals[head] == YELLOW:
            left_s = max(left_s, red_in_s[head] + 1e-6)
    if not lit:
        return True
    if left_s <= 0.0:
        return False
    braking = speed_mps * speed_mps / (2.0 * max(to_line_m, 0.1))
    if braking < YELLOW_BRAKING_MPS2:
        return False
    return bool(braking > HARDEST_BRAKING_MPS2 or 1.15 * to_line_m < speed_mps * (left_s + _LATE_S))


@compiled
def collect_requests(
    requests: Requests,
    roads: Roads,
    drivers: Drivers,
    fleet: Fleet,
    parameters: DriverParameters,
    signals: NDArray[np.uint8],
    red_in_s: Array,
    count: int,
) -> None:
    """Collect requests to enter junctions, sorted by urgency.

    Writes `fleet.stop_gap_m`, where vehicles must stop that may not enter [m], `at_stop_sign`, `refused`
    and `blocker`, each (N + C,).
    """
    requests.used[0] = 0
    for v in range(count):
        fleet.stop_gap_m[v] = np.inf
        fleet.at_stop_sign[v] = False
        fleet.refused[v], fleet.blocker[v] = 0, -1
        front = fleet.station_m[v] + 0.5 * drivers.length_m[v]
        speed = fleet.speed_mps[v]
        range_m = max(30.0, speed * speed / (2.0 * COMFORT_BRAKING_MPS2) + 12.0)
        lane = fleet.plan[v, 0]
        distance = roads.lane.length_m[lane] - front
        for hop in range(1, PLAN):
            if distance > range_m:
                break
            lane = fleet.plan[v, hop]
            if lane < 0 and roads.lane.leaves[fleet.plan[v, hop - 1]]:
                break
            if lane < 0:
                fleet.stop_gap_m[v] = max(_until_narrow(roads, fleet, v, hop, distance) - 1.0, 0.0)
                break
            before = fleet.plan[v, hop - 1]
            if roads.lane.junction[lane] >= 0 and roads.lane.junction[before] < 0:
                _request_entry(requests, roads, fleet, parameters, signals, red_in_s, v, hop, distance)
                if not holds(fleet, v, lane):
                    break
            distance += roads.lane.length_m[lane]
    _sort_requests(requests, roads, fleet)


@compiled
def _until_narrow(roads: Roads, fleet: Fleet, v: int, hop: int, distance_m: float) -> float:
    """How far a vehicle may go whose plan ends after some lanes, without a lane change [m].

    It waits behind the stop line, too, and where the first of those lanes begins to close.
    """
    ending = fleet.plan[v, hop - 1]
    halt = min(roads.lane.wide_m[ending], roads.lane.stop_m[ending] + 1.0)
    until = distance_m - roads.lane.length_m[ending] + halt
    end = distance_m
    for k in range(hop - 1, -1, -1):
        lane = fleet.plan[v, k]
        closed = roads.lane.length_m[lane] - roads.lane.wide_m[lane]
        if closed > _CLOSES_M:
            until = min(until, end - closed)
        end -= roads.lane.length_m[lane]
    return float(until)


@compiled
def _ignores(probability: float, seed: int, purpose: int, fleet: Fleet, v: int) -> bool:
    """Whether a driver pays no heed this time; drawn once for each junction that it comes to."""
    return happens(probability, seed, purpose, v, fleet.draws[v])


@compiled
def _request_entry(
    requests: Requests,
    roads: Roads,
    fleet: Fleet,
    parameters: DriverParameters,
    signals: NDArray[np.uint8],
    red_in_s: Array,
    v: int,
    hop: int,
    distance_m: float,
) -> None:
    """Let vehicle v ask to enter the junction at a hop of its plan, `distance_m` ahead of its front.

    It keeps an admission that it holds, unless its light has changed in time or it is stuck outside.
    """
    lane, before = fleet.plan[v, hop], fleet.plan[v, hop - 1]
    to_line = distance_m - (roads.lane.length_m[before] - roads.lane.stop_m[before])
    ready = permitted(roads, lane, signals, red_in_s, to_line, fleet.speed_mps[v])
    if not ready and _ignores(parameters.ignore_lights, parameters.seed, _DRAW_LIGHTS, fleet, v):
        ready = True
    if holds(fleet, v, lane):
        stuck = fleet.waited_s[v] > _STUCK_OUTSIDE_S and distance_m > _STUCK_OUTSIDE_M
        speed = fleet.speed_mps[v]
        too_late = to_line < -1.0 or speed * speed > 2.0 * HARDEST_BRAKING_MPS2 * max(to_line, 0.05)
        if (ready or too_late) and not stuck:
            return
        drop_holds_ahead(fleet, v)
    gap = to_line if to_line > -1.0 else max(distance_m - 0.3, 0.0)
    fleet.stop_gap_m[v] = min(fleet.stop_gap_m[v], max(gap, 0.0))
    heedless = _ignores(parameters.ignore_signs, parameters.seed, _DRAW_SIGNS, fleet, v)
    if roads.lane.stop_sign[lane] and not heedless:
        fleet.at_stop_sign[v] = to_line < _AT_SIGN_M
        ready = ready and fleet.stopped_s[v] >= STOP_SIGN_S
    fleet.refused[v] = REFUSED_LIGHT
    if ready:
        k = requests.used[0]
        requests.queue.vehicle[k], requests.queue.hop[k], requests.queue.distance_m[k] = v, hop, distance_m
        requests.used[0] = k + 1


@compiled
def _sort_requests(requests: Requests, roads: Roads, fleet: Fleet) -> None:
    """Sort requests: patience at its end first, then rank, then arrival, then the vehicle's number."""
    queue = requests.queue
    for k in range(requests.used[0]):
        v, distance = queue.vehicle[k], queue.distance_m[k]
        waited, rank = fleet.waited_s[v], float(roads.lane.rank[fleet.plan[v, queue.hop[k]]])
        if waited > PATIENCE_S and distance < 8.0:
            rank = 10.0
        queue.urgency[k] = 1000.0 * rank + waited - distance / max(fleet.speed_mps[v], 1.0)
    for k in range(1, requests.used[0]):
        j = k
        while j > 0 and queue.urgency[j - 1] < queue.urgency[j]:
            swap_requests(queue, j - 1, j)
            j -= 1
