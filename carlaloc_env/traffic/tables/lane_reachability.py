"""Paths from every lane to the junction lanes ahead, and the lane changes that they take.

A driver who comes up to a junction has chosen one lane through it. For every lane before that junction
the table says how many lane changes are left, to which side, where to go on otherwise, and how far
ahead the last chance lies.

Demand for lanes: a town's route follows its main streets, and main streets carry more traffic.

Walker network as record arrays that compiled functions read.
"""

from collections import deque
from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.point_tree import point_tree
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.traffic.tables.record_arrays import Flags, packed

CHANGE_ROOM_M = 18.0
"""Shortest lane on which a lane change is planned [m]."""
CLOSED_FRACTION = 0.5
"""Where a smaller fraction of all lanes leads on for ever, vehicles may leave the map."""
_FAR_M = 3000.0
"""Room beyond this makes no difference to a driver [m]."""


class GoalPaths:
    """One row for each pair of a plain lane and a junction lane that it leads to, K rows."""

    goal: Index
    """Junction lane, (K,)."""
    changes: Index
    """Lane changes that are left, (K,)."""
    side: Index
    """Where to change to from here: 1 left, −1 right, 0 nowhere yet, (K,)."""
    onward: Index
    """Lane to go on to without a change, −1 = the change must happen before this lane ends, (K,)."""
    room_m: Array
    """From the lane's end to the last station at which all changes are still possible [m], (K,)."""


def find_goal_paths(
    length_m: Array,
    junction: Index,
    left: Index,
    right: Index,
    after: Sequence[Sequence[int]],
    before: Sequence[Sequence[int]],
    driving: Flags,
) -> tuple[Index, GoalPaths, Flags, Flags]:
    """Paths from all plain lanes to the next junction.

    Args:
        length_m: Length of each lane [m], (N,).
        junction: Junction of each lane, −1 = none, (N,).
        left: Left neighbour, −1 = none, (N,).
        right: Right neighbour, −1 = none, (N,).
        after: Driving successors of each lane.
        before: Driving predecessors of each lane.
        driving: Whether cars drive on a lane, (N,).

    Returns:
        Where each lane's rows begin (N + 1,), the rows, the lanes from which one can drive for ever (N,), and
        those at whose end one leaves the map (N,): none where most lanes go on for ever without leaving it.
    """
    entries = [
        lane
        for lane in range(len(length_m))
        if junction[lane] >= 0 and any(junction[n] < 0 for n in before[lane])
    ]
    changes = {goal: _changes_to(goal, length_m, junction, left, right, before) for goal in entries}
    leaves = np.zeros(len(length_m), dtype=bool)
    lasting = _lasting(junction, after, changes, leaves)
    plain_m = np.where(driving & (junction < 0), length_m, 0.0)
    if float(np.sum(plain_m[lasting])) < CLOSED_FRACTION * float(np.sum(plain_m)):
        leaves = road_ends(driving, junction, left, right, after)
        lasting = _lasting(junction, after, changes, leaves)
    rows: list[list[tuple[int, int, int, int, float]]] = [[] for _ in length_m]
    for goal in entries:
        if lasting[goal]:
            known = changes[goal]
            for lane in sorted(known):
                rows[lane].append(_path_to(goal, lane, known, length_m, left, right, after))
    first, paths = packed(GoalPaths, rows)
    return first, paths, lasting, leaves


def road_ends(
    driving: Flags, junction: Index, left: Index, right: Index, links: Sequence[Sequence[int]]
) -> Flags:
    """Driving lanes outside junctions at which a road ends as a whole, (N,).

    Args:
        driving: Whether cars drive on a lane, (N,).
        junction: Junction of each lane, −1 = none, (N,).
        left: Left neighbour, −1 = none, (N,).
        right: Right neighbour, −1 = none, (N,).
        links: Successors of each lane, or predecessors for where roads begin.
    """
    linked = np.array([bool(ends) for ends in links], dtype=bool)
    ends: Flags = driving & (junction < 0) & ~linked
    for beside in (left, right):
        for lane in np.flatnonzero(ends).tolist():
            other = int(beside[lane])
            while other >= 0 and not linked[other]:
                other = int(beside[other])
            ends[lane] = other < 0
    return ends


def _changes_to(
    goal: int, length_m: Array, junction: Index, left: Index, right: Index, before: Sequence[Sequence[int]]
) -> dict[int, int]:
    """Fewest lane changes to a junction lane from every plain lane before it, nearest first."""
    found: dict[int, int] = {}
    queue = deque((lane, 0) for lane in before[goal] if junction[lane] < 0)
    while queue:
        lane, count = queue.popleft()
        if found.get(lane, count + 1) <= count:
            continue
        found[lane] = count
        beside = (int(left[lane]), int(right[lane]))
        queue.extendleft((m, count) for m in before[lane] if junction[m] < 0)
        if length_m[lane] >= CHANGE_ROOM_M:
            queue.extend((n, count + 1) for n in beside if n >= 0)
    return found


def _path_to(
    goal: int,
    lane: int,
    changes: dict[int, int],
    length_m: Array,
    left: Index,
    right: Index,
    after: Sequence[Sequence[int]],
) -> tuple[int, int, int, int, float]:
    """Record of `GoalPaths` from a lane to a goal."""
    count = changes[lane]
    side = 0
    if count and length_m[lane] >= CHANGE_ROOM_M:
        if changes.get(int(left[lane]), count) < count:
            side = 1
        elif changes.get(int(right[lane]), count) < count:
            side = -1
    onward, room = _onward(goal, lane, changes, after), 0.0
    ahead = onward
    while count and ahead >= 0 and room < _FAR_M and changes[ahead] == count:
        room += float(length_m[ahead])
        ahead = _onward(goal, ahead, changes, after)
    return goal, count, side, onward, room


def _onward(goal: int, lane: int, changes: dict[int, int], after: Sequence[Sequence[int]]) -> int:
    if goal in after[lane]:
        return goal
    options = [n for n in after[lane] if changes.get(n, changes[lane] + 1) <= changes[lane]]
    return min(options, key=lambda n: (changes[n], n)) if options else -1


def _lasting(
    junction: Index, after: Sequence[Sequence[int]], changes: dict[int, dict[int, int]], leaves: Flags
) -> Flags:
    """Lanes that lead on for ever, or out of the map: dead ends are peeled off until nothing changes."""
    reached: list[list[int]] = [[] for _ in junction]
    for goal, known in changes.items():
        for lane in known:
            reached[lane].append(goal)
    lasting = np.array([bool(own) or bool(goals) for own, goals in zip(after, reached, strict=True)]) | leaves
    peeling = True
    while peeling:
        peeling = False
        for lane in np.flatnonzero(lasting & ~leaves).tolist():
            if not any(lasting[n] for n in after[lane]) and not any(lasting[n] for n in reached[lane]):
                lasting[lane] = False
                peeling = True
    return lasting


SIDEWALK, CROSSWALK = 0, 1
"""Kinds of walker paths."""


class WalkerPaths:
    """Paths of walkers, sidewalks and crosswalks, F rows."""

    kind: Index
    """SIDEWALK or CROSSWALK."""
    length_m: Array
    """Length [m]."""
    own_side: Array
    """Side on which walkers keep: −1 right, 1 left where traffic keeps to the left."""
    demand: Array
    """How much more often walkers choose it than one in a side street."""
    row_first: Index
    row_count: Index
    row_step_m: Array
    """Spacing of the samples [m]."""
    kerb_m: Annotated[Array, 2]
    """Crosswalks: stations between which it lies on the carriageway [m]."""
    entry_first: Index
    entry_end: Index
    """Sidewalks: rows of `CrosswalkEntries`, in the order of their stations."""
    join_first: Annotated[Index, 2]
    """Where the joins at start and end begin."""
    join_end: Annotated[Index, 2]
    lane_crossing_first: Index
    lane_crossing_end: Index
    """Crosswalks: rows of `LaneCrossings`."""


class WalkerPathSamples:
    """Samples along walker paths, R rows."""

    position_m: Annotated[Array, 3]
    """World [m]."""
    tangent: Annotated[Array, 2]
    """Cosine and sine of the direction."""
    width_m: Array
    """Width [m]."""


class CrosswalkEntries:
    """Points at which crosswalks leave sidewalks."""

    station_m: Array
    """Station on the sidewalk [m]."""
    crosswalk: Index
    """Path over the road."""
    end: Index
    """Which end of it lies here: 0 start, 1 end."""


class LaneCrossings:
    """Lanes that a crosswalk crosses."""

    crossing: Index
    """Row of `Roads.crossing`."""
    near_m: Array
    """Station of the path at which the lane begins [m]."""
    far_m: Array
    """Station at which it ends [m]."""
    head_first: Index
    head_end: Index
    """Lights that stop traffic on the lane, so that walkers may cross: rows of `WalkerNetwork.head`."""


class WalkerNetwork(NamedTuple):
    """Walker network of a town: paths, their samples, and how they join."""

    path: WalkerPaths
    """Paths, (F,)."""
    row: WalkerPathSamples
    """Samples of all paths, (R,)."""
    entry: CrosswalkEntries
    """Entries of crosswalks."""
    lane_crossing: LaneCrossings
    """Crossings of crosswalks and lanes."""
    join_path: Index
    """Paths that join others, end to end."""
    join_end: Index
    """Which end of each of them joins."""
    landing: Annotated[Index, 2]
    """Sidewalk at start and end of each crosswalk, −1 for sidewalks, (F, 2)."""
    landing_m: Array
    """Station there [m], (F, 2)."""
    head: Index
    """Numbers of signal heads, end to end."""


MAIN_STREET_DEMAND = 6.0
"""How much more often drivers choose a main street than a side street, as long as it is not crowded."""
ROUTE_DEMAND = 1.0
"""The same for the direction in which the route runs: the stream comes towards it, as in rush hours."""
WALKER_DEMAND = 25.0
"""How much more often walkers choose the sidewalks of a main street: shops, stops and offices lie there."""
STREET_REACH_M = 20.0
"""Lanes this close to the route belong to the same street [m], as do its sidewalks."""
_HEIGHT_M = 4.0
"""What is farther above or below the route is another street [m]."""


def lane_demand(network: LaneNetwork, route_m: Array | None) -> Array:
    """Demand for each lane, 1 on side streets and up to `MAIN_STREET_DEMAND` along the route, (N,).

    Args:
        network: The lanes.
        route_m: Points of the town's route [m], (K, 3), world, in order; None: no street is a main street.
    """
    tables = network.tables
    if route_m is None or not len(tables.first):
        return np.ones(len(tables.first))
    near, along = along_route(tables.position_m, tables.tangent[:, :2], route_m)
    of_sample = np.where(near, np.where(along, ROUTE_DEMAND, MAIN_STREET_DEMAND), 1.0)
    demand: Array = np.add.reduceat(of_sample, tables.first) / tables.count
    return demand


def stretch_demand(demand: Array, stretch: Index, length_m: Array) -> Array:
    """Mean demand of the stretch that each lane belongs to, weighted by length, (N,)."""
    total_m = np.bincount(stretch, weights=length_m)[stretch]
    mean: Array = np.bincount(stretch, weights=demand * length_m)[stretch] / np.maximum(total_m, 1e-9)
    return mean


def walker_demand(walker_network: WalkerNetwork, route_m: Array | None) -> Array:
    """Demand for each path of walkers, 1 in side streets and up to `WALKER_DEMAND` along the route, (F,).

    Args:
        walker_network: Sidewalks and crosswalks.
        route_m: Points of the town's route [m], (K, 3), world, in order; None: no street is a main street.
    """
    path, row = walker_network.path, walker_network.row
    if route_m is None or not len(path.kind):
        return np.ones(len(path.kind))
    near, _ = along_route(row.position_m, row.tangent, route_m)
    demand: Array = np.add.reduceat(np.where(near, WALKER_DEMAND, 1.0), path.row_first) / path.row_count
    return demand


def along_route(points_m: Array, tangents: Array, route_m: Array) -> tuple[Flags, Flags]:
    """Which points (M, 3) lie in a street of the route, and which of them head where it does, (M,) each.

    Args:
        points_m: Points of lanes or sidewalks [m], (M, 3).
        tangents: Their directions, (M, 2).
        route_m: Points of the route [m], (K, 3), in order.
    """
    distance_m, row = point_tree(route_m[:, :2]).query(points_m[:, :2])
    near = (distance_m < STREET_REACH_M) & (np.abs(points_m[:, 2] - route_m[row, 2]) < _HEIGHT_M)
    direction = np.gradient(route_m[:, :2], axis=0)[row]
    return near, np.sum(direction * tangents, axis=1) > 0.0


def weighted_order(draw: np.random.Generator, weight: Array, group: Index | None = None) -> Index:
    """A random order in which heavier things come first more often, (N,).

    Efraimidis & Spirakis, "Weighted random sampling with a reservoir" (2006): by falling u^(1/w).

    Args:
        draw: Where random numbers come from.
        weight: Weight of each thing, (N,).
        group: Number of the group, from 0, to which each belongs, (N,): those of a group with one weight come
            one after the other; None: each forms a group.
    """
    uniform = draw.random(len(weight))
    drawn = uniform if group is None else uniform[group]
    order: Index = np.argsort(elementary.log(drawn) / weight, kind="stable")[::-1]
    return order
