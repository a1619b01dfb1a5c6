"""Walker network of a town: sidewalks, and crosswalks from one sidewalk to another."""

from typing import NamedTuple

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.point_tree import point_tree
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.lanes.lanes import Crosswalk
from carlaloc_env.traffic.tables.lane_tables import Crossings, Roads
from carlaloc_env.traffic.tables.record_arrays import columns, fill, packed, starts
from carlaloc_env.traffic.tables.walker_network import (
    CROSSWALK,
    SIDEWALK,
    CrosswalkEntries,
    LaneCrossings,
    WalkerNetwork,
    WalkerPaths,
    WalkerPathSamples,
)

STEP_M = 0.5
"""Spacing of samples along crosswalks [m]."""
_SHORTEST_M = 1.0
"""Shorter sidewalk lanes are left out [m]."""
_JOIN_M = 1.5
"""Ends of sidewalks this close to each other join [m]."""
_LANDING_RANGE_M = 7.0
"""Distance from a crosswalk's end within which a sidewalk must lie [m]."""
_KERB_M = 0.2
"""Margin beside a lane within which walkers still hold up its traffic [m]."""


class _Line(NamedTuple):
    points_m: Array
    width_m: Array
    own_side: int


def build_walker_network(network: LaneNetwork, roads: Roads) -> WalkerNetwork:
    """Walker network of a town; crosswalks without a sidewalk near both ends are left out."""
    lines = _sidewalks(network)
    sidewalks = len(lines)
    landing: list[tuple[int, int]] = [(-1, -1)] * sidewalks
    landing_m: list[tuple[float, float]] = [(0.0, 0.0)] * sidewalks
    kerbs: list[tuple[float, float]] = [(0.0, 0.0)] * sidewalks
    numbers: list[int] = [-1] * sidewalks
    finder = _SidewalkFinder(lines)
    for number, crosswalk in enumerate(network.crosswalks):
        ends = [finder.nearest(point) for point in (crosswalk.start_m, crosswalk.end_m)]
        if any(end is None for end in ends):
            continue
        (a, a_m, a_point), (b, b_m, b_point) = ends  # type: ignore[misc]
        points = np.array([a_point, crosswalk.start_m, crosswalk.end_m, b_point])
        lead = float(np.hypot(*(points[1] - points[0])[:2]))
        across = float(np.hypot(*(points[2] - points[1])[:2]))
        lines.append(_resampled(points, crosswalk.width_m, lines[a].own_side))
        landing.append((a, b))
        landing_m.append((a_m, b_m))
        kerbs.append((lead, lead + across))
        numbers.append(number)
    return _packed(network, roads, lines, sidewalks, landing, landing_m, kerbs, numbers)


def _sidewalks(network: LaneNetwork) -> list[_Line]:
    lines = []
    tables = network.tables
    for lane in network.lanes:
        if lane.type == "sidewalk" and lane.length_m > _SHORTEST_M:
            first = int(tables.first[lane.index])
            rows = slice(first, first + int(tables.count[lane.index]))
            lines.append(_Line(tables.position_m[rows], tables.width_m[rows], lane.kerb_side))
    return lines


class _SidewalkFinder:
    """Nearest sample of all sidewalks."""

    def __init__(self, lines: list[_Line]) -> None:
        self._points = np.concatenate([line.points_m for line in lines] or [np.zeros((0, 3))])
        self._owner = np.repeat(np.arange(len(lines)), [len(line.points_m) for line in lines])
        self._first = starts([line.points_m for line in lines])
        self._lines = lines
        self._tree = point_tree(self._points) if len(self._points) else None

    def nearest(self, point_m: Array) -> tuple[int, float, Array] | None:
        """Sidewalk, station [m] and point (3,) nearest to a point, None without a sidewalk in range."""
        if self._tree is None:
            return None
        distance, row = self._tree.query(point_m)
        if distance > _LANDING_RANGE_M:
            return None
        owner = int(self._owner[row])
        station = float(_stations(self._lines[owner].points_m)[row - self._first[owner]])
        return owner, station, self._points[row]


def _stations(points_m: Array) -> Array:
    step = np.diff(points_m[:, :2], axis=0)
    return np.concatenate([[0.0], np.cumsum(np.hypot(step[:, 0], step[:, 1]))])


def _resampled(points_m: Array, width_m: float, own_side: int) -> _Line:
    station = _stations(points_m)
    count = max(2, int(np.ceil(station[-1] / STEP_M)) + 1)
    at = np.linspace(0.0, station[-1], count)
    line = np.stack([np.interp(at, station, points_m[:, k]) for k in range(3)], axis=-1)
    return _Line(line, np.full(count, width_m), own_side)


def _packed(
    network: LaneNetwork,
    roads: Roads,
    lines: list[_Line],
    sidewalks: int,
    landing: list[tuple[int, int]],
    landing_m: list[tuple[float, float]],
    kerbs: list[tuple[float, float]],
    numbers: list[int],
) -> WalkerNetwork:
    count = len(lines)
    station = [_stations(line.points_m) for line in lines]
    row_first = starts(station)
    entries: list[list[tuple[float, int, int]]] = [[] for _ in lines]
    for path in range(sidewalks, count):
        for end in range(2):
            entries[landing[path][end]].append((landing_m[path][end], path, end))
    for of_sidewalk in entries:
        of_sidewalk.sort()
    joins = _joins(lines[:sidewalks])
    joins += [([], []) for _ in range(sidewalks, count)]
    lane_crossings, heads = _lane_crossings(network, roads, lines, numbers, kerbs)
    flat_joins = [ends[k] for ends in joins for k in range(2)]
    join_starts, crossing_starts = starts(flat_joins), starts(lane_crossings)
    entry_starts, entry = packed(CrosswalkEntries, entries)
    paths = fill(
        WalkerPaths,
        count,
        kind=[CROSSWALK if number >= 0 else SIDEWALK for number in numbers],
        length_m=[along[-1] for along in station],
        own_side=[line.own_side for line in lines],
        demand=np.ones(count),
        row_first=row_first[:-1],
        row_count=np.diff(row_first),
        row_step_m=[max(along[-1] / (len(along) - 1), 1e-6) for along in station],
        kerb_m=np.array(kerbs).reshape(-1, 2),
        entry_first=entry_starts[:-1],
        entry_end=entry_starts[1:],
        join_first=join_starts[:-1].reshape(-1, 2),
        join_end=join_starts[1:].reshape(-1, 2),
        lane_crossing_first=crossing_starts[:-1],
        lane_crossing_end=crossing_starts[1:],
    )
    rows = columns(WalkerPathSamples, int(row_first[-1]))
    if count:
        rows.position_m[...] = np.concatenate([line.points_m for line in lines])
        rows.width_m[...] = np.concatenate([line.width_m for line in lines])
        rows.tangent[...] = np.concatenate([_tangents(line.points_m) for line in lines])
    flat_crossings = [item for crossings in lane_crossings for item in crossings]
    head_starts = starts([heads[item[0]] for item in flat_crossings])
    return WalkerNetwork(
        path=paths,
        row=rows,
        entry=entry,
        lane_crossing=fill(
            LaneCrossings,
            len(flat_crossings),
            crossing=[item[0] for item in flat_crossings],
            near_m=[item[1] for item in flat_crossings],
            far_m=[item[2] for item in flat_crossings],
            head_first=head_starts[:-1],
            head_end=head_starts[1:],
        ),
        join_path=np.array([path for ends in flat_joins for path, _ in ends], dtype=np.int64),
        join_end=np.array([end for ends in flat_joins for _, end in ends], dtype=np.int64),
        landing=np.array(landing, dtype=np.int64).reshape(-1, 2),
        landing_m=np.array(landing_m, dtype=np.float64).reshape(-1, 2),
        head=np.array([head for item in flat_crossings for head in heads[item[0]]], dtype=np.int64),
    )


def _tangents(points_m: Array) -> Array:
    step = np.gradient(points_m[:, :2], axis=0)
    return step / np.maximum(np.hypot(step[:, 0], step[:, 1]), 1e-9)[:, None]


def _joins(lines: list[_Line]) -> list[tuple[list[tuple[int, int]], list[tuple[int, int]]]]:
    """For start and end of each sidewalk, the ends of others that meet it there."""
    if not lines:
        return []
    ends = np.array([line.points_m[k] for line in lines for k in (0, -1)])
    near = point_tree(ends).query_ball_point(ends, _JOIN_M)

    def met(end: int) -> list[tuple[int, int]]:
        return [divmod(k, 2) for k in sorted(near[end]) if k // 2 != end // 2]

    return [(met(2 * path), met(2 * path + 1)) for path in range(len(lines))]


def _lane_crossings(
    network: LaneNetwork,
    roads: Roads,
    lines: list[_Line],
    numbers: list[int],
    kerbs: list[tuple[float, float]],
) -> tuple[list[list[tuple[int, float, float]]], dict[int, list[int]]]:
    """For each path the lanes that it crosses, and for each such crossing the lights that hold traffic."""
    crossing = roads.crossing
    of_crosswalk: dict[int, list[int]] = {}
    for row, number in enumerate(crossing.crosswalk):
        of_crosswalk.setdefault(int(number), []).append(row)
    lane_crossings: list[list[tuple[int, float, float]]] = []
    heads: dict[int, list[int]] = {}
    for path in range(len(lines)):
        of_path = []
        for row in of_crosswalk.get(numbers[path], []) if numbers[path] >= 0 else []:
            near, far = _span(network, network.crosswalks[numbers[path]], crossing, row, kerbs[path])
            of_path.append((row, near, far))
            heads[row] = _holding_heads(network, int(crossing.lane[row]), float(crossing.enter_m[row]))
        lane_crossings.append(of_path)
    return lane_crossings, heads


def _span(
    network: LaneNetwork, crosswalk: Crosswalk, crossing: Crossings, row: int, kerb_m: tuple[float, float]
) -> tuple[float, float]:
    """Stations of the path between which it crosses a lane [m]."""
    lane = int(crossing.lane[row])
    middle = 0.5 * float(crossing.enter_m[row] + crossing.leave_m[row])
    point = network.pose([lane], [middle]).position_m[0, :2]
    path = crosswalk.end_m[:2] - crosswalk.start_m[:2]
    length = float(np.hypot(path[0], path[1]))
    at = kerb_m[0] + float(np.sum((point - crosswalk.start_m[:2]) * path)) / length
    half = 0.5 * float(network.width_m([lane], [middle])[0]) + _KERB_M
    return at - half, at + half


def _holding_heads(network: LaneNetwork, lane: int, enter_m: float) -> list[int]:
    """Lights whose stop line on the lane lies close before the crosswalk."""
    return [
        index
        for index, head in enumerate(network.signals)
        for held, stop in zip(head.lanes, head.stop_station_m, strict=True)
        if held == lane and -2.0 < enter_m - stop < 15.0
    ]
