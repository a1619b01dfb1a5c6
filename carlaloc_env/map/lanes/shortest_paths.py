"""Cheapest ways over lanes: successors, and lane changes where needed."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from carlaloc_env.core.errors import MapError
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.lanes.topology import DRIVABLE_TYPES

LANE_CHANGE_COST_M = 60.0
"""A lane change is worth this detour."""
LANE_CHANGE_ROOM_M = 8.0
"""Least length of lane for one change."""
EASY_ROOM_M = 35.0
"""Length of lane for each change below which haste costs [m]."""
HASTE_COST = 5.0
"""Each metre of lane short of an easy change counts as so many metres of detour."""


@dataclass(frozen=True, slots=True)
class LanePosition:
    """A point on a lane."""

    lane: int
    station_m: float


@dataclass(frozen=True, slots=True)
class LaneSpan:
    """A stretch of one lane, or of neighbouring lanes that are changed in turn."""

    lanes: tuple[int, ...]
    from_fraction: float
    """Where it starts, as a share of the first lane's length."""
    to_fraction: float
    """Where it ends, as a share of the last lane's length."""


@dataclass(frozen=True, slots=True)
class _Visit:
    cost_m: float
    lane: int
    fraction: float
    changes: tuple[int, ...]
    """Lanes of this stretch before the present one."""
    before: _Visit | None


def cheapest_path(
    network: LaneNetwork, start: LanePosition, goals: Sequence[LanePosition]
) -> Mapping[int, tuple[float, list[LaneSpan]]]:
    """Costs [m] and spans from a place to each goal that can be reached (by its number); Dijkstra."""
    wanted: dict[int, list[int]] = {}
    for number, goal in enumerate(goals):
        wanted.setdefault(goal.lane, []).append(number)
    paths: dict[int, tuple[float, list[LaneSpan]]] = {}
    order = 0
    length = network.lanes[start.lane].length_m
    fraction = min(start.station_m / length, 1.0) if length > 0.0 else 0.0
    heap: list[tuple[float, int, _Visit]] = [(0.0, order, _Visit(0.0, start.lane, fraction, (), None))]
    settled: set[tuple[int, bool]] = set()
    best_possible = float("inf")
    while heap and (len(paths) < len(goals) or heap[0][0] <= best_possible):
        _, _, visit = heapq.heappop(heap)
        key = (visit.lane, visit.fraction > 0.0)
        if key in settled:
            continue
        settled.add(key)
        _reach_goals(network, visit, goals, wanted.get(visit.lane, ()), paths)
        if len(paths) == len(goals):
            best_possible = max(cost for cost, _ in paths.values())
        for following in _onward(network, visit):
            order += 1
            heapq.heappush(heap, (following.cost_m, order, following))
    return paths


def _reach_goals(
    network: LaneNetwork,
    visit: _Visit,
    goals: Sequence[LanePosition],
    numbers: Sequence[int],
    paths: dict[int, tuple[float, list[LaneSpan]]],
) -> None:
    length = network.lanes[visit.lane].length_m
    for number in numbers:
        fraction = goals[number].station_m / length if length > 0.0 else 0.0
        room = (fraction - visit.fraction) * length
        if fraction < visit.fraction - 1e-9 or room < LANE_CHANGE_ROOM_M * len(visit.changes):
            continue
        cost = visit.cost_m + room
        if number not in paths or cost < paths[number][0]:
            paths[number] = (cost, _spans(visit, min(fraction, 1.0)))


def _onward(network: LaneNetwork, visit: _Visit) -> list[_Visit]:
    lane = network.lanes[visit.lane]
    rest = (1.0 - visit.fraction) * lane.length_m
    visits = [
        _Visit(visit.cost_m + rest, n, 0.0, (), visit)
        for n in lane.successors
        if network.lanes[n].type in DRIVABLE_TYPES
    ]
    if lane.junction_id is None and rest >= LANE_CHANGE_ROOM_M * (len(visit.changes) + 1):
        haste = HASTE_COST * max(EASY_ROOM_M * (len(visit.changes) + 1) - rest, 0.0)
        visits += [
            _Visit(
                visit.cost_m + LANE_CHANGE_COST_M + haste,
                n,
                visit.fraction,
                (*visit.changes, visit.lane),
                visit.before,
            )
            for n in (lane.left, lane.right)
            if n is not None and n not in visit.changes
        ]
    return visits


def _spans(visit: _Visit, to_fraction: float) -> list[LaneSpan]:
    spans = []
    last: _Visit | None = visit
    while last is not None:
        spans.append(LaneSpan((*last.changes, last.lane), last.fraction, to_fraction))
        last, to_fraction = last.before, 1.0
    return spans[::-1]


def path_through(network: LaneNetwork, stops: Sequence[Sequence[LanePosition]]) -> list[LaneSpan]:
    """Spans of the cheapest path that visits one place of each stop, in order.

    Raises:
        MapError: No path exists.
    """
    best: list[tuple[float, list[LaneSpan]] | None] = [(0.0, []) for _ in stops[0]]
    for number, (here, there) in enumerate(itertools.pairwise(stops)):
        following: list[tuple[float, list[LaneSpan]] | None] = [None] * len(there)
        for place, so_far in zip(here, best, strict=True):
            if so_far is None:
                continue
            for k, (cost, spans) in cheapest_path(network, place, there).items():
                total = so_far[0] + cost
                cheapest = following[k]
                if cheapest is None or total < cheapest[0]:
                    following[k] = (total, so_far[1] + spans)
        best = following
        if all(path is None for path in best):
            raise MapError(
                f"no way leads from route point {number + 1} to point {number + 2}; "
                "move one of them onto a lane that leads there"
            )
    return min((path for path in best if path is not None), key=lambda path: path[0])[1]
