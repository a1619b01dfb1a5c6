"""A route for a town whose owner has given none: along lanes, by the roads least driven so far."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.errors import MapError
from carlaloc_env.town.network import LaneNetwork
from carlaloc_env.town.route import Route, plan_route

ROUTE_LENGTH_M = 1000.0
"""Length sought."""
_STARTS = 12
_POINT_ROOM_M = 15.0


def lanes_that_go_on(network: LaneNetwork) -> NDArray[np.bool_]:
    """Driving lanes from which one can drive for ever: dead ends are peeled off until nothing changes."""
    alive = np.array([lane.type == "driving" for lane in network.lanes], dtype=bool)
    changed = True
    while changed:
        changed = False
        for lane in network.lanes:
            if alive[lane.index] and not any(alive[after] for after in lane.successors):
                alive[lane.index] = False
                changed = True
    return alive


def choose_route(network: LaneNetwork, length_m: float = ROUTE_LENGTH_M) -> Route | None:
    """An open route of about this length [m], or the longest found; None if nothing can be driven.

    It begins on one of the longest lanes and turns, wherever it can, into the lane least driven.
    """
    onward = lanes_that_go_on(network)
    allowed = onward if onward.any() else np.array([lane.type == "driving" for lane in network.lanes])
    starts = sorted(
        (lane for lane in network.lanes if allowed[lane.index] and lane.junction_id is None),
        key=lambda lane: (-lane.length_m, lane.index),
    )
    best: Route | None = None
    for start in starts[:_STARTS]:
        route = _planned(network, _walk(network, allowed, start.index, 1.2 * length_m), length_m)
        if route is not None and (best is None or route.length_m > best.length_m):
            best = route
        if best is not None and best.length_m > 0.98 * length_m:
            break
    return best


def _walk(network: LaneNetwork, allowed: NDArray[np.bool_], start: int, length_m: float) -> list[int]:
    visits = np.zeros(len(network.lanes), np.int64)
    lanes, driven_m = [start], network.lanes[start].length_m
    while driven_m < length_m:
        visits[lanes[-1]] += 1
        options = [after for after in network.lanes[lanes[-1]].successors if allowed[after]]
        if not options:
            break
        lanes.append(min(options, key=lambda lane: (int(visits[lane]), lane)))
        driven_m += network.lanes[lanes[-1]].length_m
    return lanes


def _planned(network: LaneNetwork, lanes: list[int], length_m: float) -> Route | None:
    through = [
        lane
        for lane in lanes
        if network.lanes[lane].junction_id is None and network.lanes[lane].length_m > _POINT_ROOM_M
    ]
    if len(through) < 2:
        return None
    middle = np.array([0.5 * network.lanes[lane].length_m for lane in through])
    places = network.pose(np.array(through), middle).position_m
    points = [(float(x), float(y)) for x, y, _ in places]
    try:
        route = plan_route(network, points)
        return plan_route(network, points, length_m=length_m) if route.length_m > length_m else route
    except MapError:
        return None
