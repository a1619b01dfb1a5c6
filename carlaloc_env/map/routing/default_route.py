"""The default route of a town: along lanes, by the roads least driven so far."""

from collections import defaultdict

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import MapError
from carlaloc_env.core.transforms import wrap_angle
from carlaloc_env.map.lanes.build_lanes import CAR_WIDTH_M
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.routing.plan_route import FitTurns, plan_route
from carlaloc_env.map.routing.route import Route

ROUTE_LENGTH_M = 1000.0
"""Length sought."""
_STARTS = 12
_POINT_ROOM_M, _END_ROOM_M = 15.0, 5.0
_LOOP_SHARES = (0.25, 0.5, 0.75)
"""Places on a lane that leads back into itself through which a loop is planned."""
_WALKED, _LOOP_OFF = 6.0, 0.5
"""A walk that is searched for a loop has so many lengths; a loop may be longer or shorter by this share."""
_BACK_RAD, _LEAST_RADIUS_M = 2.4, 4.0


def lanes_that_go_on(network: LaneNetwork, usable: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
    """Driving lanes from which one can drive for ever: dead ends are peeled off until nothing changes.

    Args:
        network: The lanes.
        usable: Which lanes may be driven, (N,); all driving lanes when left out.
    """
    alive = np.array([lane.type == "driving" for lane in network.lanes], dtype=bool)
    if usable is not None:
        alive &= usable
    changed = True
    while changed:
        changed = False
        for lane in network.lanes:
            if alive[lane.index] and not any(alive[after] for after in lane.successors):
                alive[lane.index] = False
                changed = True
    return alive


def choose_route(
    network: LaneNetwork,
    length_m: float = ROUTE_LENGTH_M,
    avoided: NDArray[np.bool_] | None = None,
    *,
    fit_turns: FitTurns | None = None,
) -> Route | None:
    """An open route of about this length [m], or the longest found; None if nothing can be driven.

    It begins on one of the longest lanes and turns, wherever it can, into the lane least driven; where all
    roads lead out of the map, it takes those on which most is to come. Turns on the spot are left to others,
    and so are lanes that begin or end narrower than a car, and `avoided` ones (N,) where there are others.
    A map that is nothing but one lane that leads back into itself has a loop. `fit_turns` is `plan_route`'s.
    """
    onward, usable = _lanes_to_drive(network, avoided)
    allowed = onward if onward.any() else usable
    to_come_m = np.zeros(len(allowed)) if onward.any() else _ways_to_come(network, usable)
    starts = _starts(network, allowed, to_come_m)
    best: Route | None = None
    for start in starts:
        lanes = _walk(network, allowed, to_come_m, start, 1.2 * length_m)
        route = _planned(network, lanes, length_m, fit_turns, whole=not onward.any())
        if route is not None and (best is None or route.length_m > best.length_m):
            best = route
        if best is not None and best.length_m > 0.98 * length_m:
            break
    return best or next(filter(None, (_loop(network, start, fit_turns) for start in starts)), None)


def choose_loop(
    network: LaneNetwork,
    length_m: float = ROUTE_LENGTH_M,
    avoided: NDArray[np.bool_] | None = None,
    *,
    fit_turns: FitTurns | None = None,
    worth: Array | None = None,
) -> Route | None:
    """A closed route of about this length [m], by lanes that `choose_route` would drive; None without one.

    Among the rounds of its walks, the one over the most lanes that it does not drive twice is taken;
    `avoided` ones (N,) do not count. Others count by their `worth` (N,), 1 each when left out; where it is
    given, the shortest ways round from the worthiest lanes compete, too.
    """
    onward, _ = _lanes_to_drive(network, avoided)
    worth_m = network.tables.length_m * (1.0 if avoided is None else ~avoided)
    worth_m = worth_m if worth is None else worth_m * worth
    rounds: list[tuple[float, list[int]]] = []
    for start in _starts(network, onward, np.zeros(len(onward)) if worth is None else worth_m):
        lanes = _walk(network, onward, np.zeros(len(onward)), start, _WALKED * length_m)
        rounds += _rounds(network, lanes, length_m, worth_m)
        if worth is not None:
            rounds += _rounds(network, _shortest_round(network, onward, start), length_m, worth_m)
    for _, lanes in sorted(rounds, key=lambda scored: -scored[0]):
        route = _planned(network, lanes, length_m, fit_turns, whole=False, loop=True)
        if route is not None:
            return route
    return None


def _rounds(
    network: LaneNetwork, lanes: list[int], length_m: float, worth_m: Array
) -> list[tuple[float, list[int]]]:
    """Parts of a walk that end where they began, the first lane not repeated, with their scores."""
    at_m = np.cumsum([0.0, *(network.lanes[lane].length_m for lane in lanes)])
    before: dict[int, list[int]] = defaultdict(list)
    rounds = []
    for end, lane in enumerate(lanes):
        for begin in before[lane]:
            round_m = float(at_m[end] - at_m[begin])
            if abs(round_m - length_m) <= _LOOP_OFF * length_m:
                once_m = float(worth_m[np.unique(lanes[begin:end])].sum())
                rounds.append((once_m - abs(round_m - length_m), lanes[begin:end]))
        if network.lanes[lane].junction_id is None and network.lanes[lane].length_m > _POINT_ROOM_M:
            before[lane].append(end)
    return rounds


def _shortest_round(network: LaneNetwork, allowed: NDArray[np.bool_], start: int) -> list[int]:
    """The shortest way from a lane back to it, with this lane at both ends; without one, nothing."""
    pairs = [(lane.index, after) for lane in network.lanes if allowed[lane.index]
             for after in lane.successors if allowed[after]]  # fmt: skip
    sources, targets = np.reshape(pairs, (-1, 2)).T
    shape = (len(network.lanes), len(network.lanes))
    graph = csr_array((network.tables.length_m[targets], (sources, targets)), shape=shape)
    (far_m,), (before,) = dijkstra(graph, indices=[start], return_predecessors=True)
    lanes = [
        start,
        min(network.lanes[start].predecessors, key=lambda lane: float(far_m[lane]), default=start),
    ]
    while np.isfinite(far_m[lanes[-1]]) and lanes[-1] != start:
        lanes.append(int(before[lanes[-1]]))
    return lanes[::-1] if lanes[-1] == start and len(lanes) > 2 else []


def _lanes_to_drive(
    network: LaneNetwork, avoided: NDArray[np.bool_] | None
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Lanes from which one can drive for ever, and all that may be driven, (N,) each."""
    driving = np.array([lane.type == "driving" for lane in network.lanes], dtype=bool)
    least_m = np.minimum.reduceat(network.tables.width_m, network.tables.first)
    easy = driving & ~_turns_on_the_spot(network) & (least_m >= CAR_WIDTH_M)
    if avoided is not None and lanes_that_go_on(network, easy & ~avoided).any():
        easy &= ~avoided
    onward = lanes_that_go_on(network, easy)
    if not onward.any():
        onward = lanes_that_go_on(network)
    return onward, easy if easy.any() else driving


def _starts(network: LaneNetwork, allowed: NDArray[np.bool_], to_come_m: Array) -> list[int]:
    """Lanes at which a walk may begin, the best first."""
    lanes = sorted(
        (lane for lane in network.lanes if allowed[lane.index] and lane.junction_id is None),
        key=lambda lane: (-float(to_come_m[lane.index]), -lane.length_m, lane.index),
    )
    return [lane.index for lane in lanes[:_STARTS]]


def _loop(network: LaneNetwork, lane: int, fit_turns: FitTurns | None) -> Route | None:
    """The shortest way round from a lane to itself."""
    at = np.array(_LOOP_SHARES) * network.lanes[lane].length_m
    places = network.pose(np.full(len(at), lane), at).position_m
    try:
        points = [(float(x), float(y)) for x, y, _ in places]
        return plan_route(network, points, loop=True, fit_turns=fit_turns)
    except MapError:
        return None


def _turns_on_the_spot(network: LaneNetwork) -> NDArray[np.bool_]:
    """Lanes that turn back, or to and fro as much, within a length in which no car turns, (N,).

    Kinks against the lanes before and behind count: connections of some maps are curved less than they turn.
    """
    tables = network.tables
    heading, first = tables.heading_rad, tables.first
    last = first + tables.count - 1
    step = np.abs(wrap_angle(np.diff(heading, prepend=heading[:1])))
    step[first] = 0.0
    turned = np.add.reduceat(step, first)
    for lane in network.lanes:
        n = lane.index
        for others, ours, theirs in ((lane.predecessors, first, last), (lane.successors, last, first)):
            kinks = [abs(float(wrap_angle(heading[ours[n]] - heading[theirs[k]]))) for k in others]
            turned[n] += min(kinks, default=0.0)
    result: NDArray[np.bool_] = (turned > _BACK_RAD) & (tables.length_m < _LEAST_RADIUS_M * np.pi)
    return result


def _ways_to_come(network: LaneNetwork, usable: NDArray[np.bool_]) -> Array:
    """Longest way that one can drive from the beginning of each lane of a map without rings [m], (N,)."""
    longest_m = np.zeros(len(usable))
    waiting = [n for n in range(len(usable)) if usable[n]]
    while waiting:
        lane = network.lanes[waiting.pop()]
        after = max((float(longest_m[n]) for n in lane.successors if usable[n]), default=0.0)
        if lane.length_m + after > longest_m[lane.index] + 1e-6:
            longest_m[lane.index] = lane.length_m + after
            waiting += [n for n in lane.predecessors if usable[n]]
    return longest_m


def _walk(
    network: LaneNetwork, allowed: NDArray[np.bool_], to_come_m: Array, start: int, length_m: float
) -> list[int]:
    visits = np.zeros(len(network.lanes), np.int64)
    lanes, driven_m = [start], network.lanes[start].length_m
    while driven_m < length_m:
        visits[lanes[-1]] += 1
        options = [after for after in network.lanes[lanes[-1]].successors if allowed[after]]
        if not options:
            break
        lanes.append(min(options, key=lambda lane: (-float(to_come_m[lane]), int(visits[lane]), lane)))
        driven_m += network.lanes[lanes[-1]].length_m
    return lanes


def _planned(
    network: LaneNetwork,
    lanes: list[int],
    length_m: float,
    fit_turns: FitTurns | None,
    *,
    whole: bool,
    loop: bool = False,
) -> Route | None:
    """The route over these lanes, from the first one's middle to the last one's, or over all of both."""
    through = [
        lane
        for lane in lanes
        if network.lanes[lane].junction_id is None and network.lanes[lane].length_m > _POINT_ROOM_M
    ]
    if whole and not through:
        through = lanes
    if len(through) < (1 if whole else 2):
        return None
    middle = np.array([0.5 * network.lanes[lane].length_m for lane in through])
    if whole:
        ends = np.minimum(_END_ROOM_M, 0.5 * middle[[0, -1]])
        through = [through[0], *through, through[-1]]
        middle = np.concatenate([ends[:1], middle, 2.0 * middle[-1:] - ends[1:]])
    places = network.pose(np.array(through), middle).position_m
    points = [(float(x), float(y)) for x, y, _ in places]
    try:
        route = plan_route(network, points, loop=loop, fit_turns=fit_turns)
        return route if loop or route.length_m <= length_m else route.cut_start(length_m)
    except MapError:
        return None
