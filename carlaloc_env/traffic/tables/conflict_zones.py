"""Conflict zones of junctions: where two lanes meet, and which of them ranks first."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.point_tree import point_tree
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.traffic.tables.record_arrays import Flags, packed

Links = Sequence[Sequence[int]]
"""For each lane, the lanes that it is linked to."""
_Row = tuple[int, int, float, float, float, float]
"""Columns of `Zones` in their order."""

_SAMPLE_M = 0.5
"""Spacing of the samples between which zones are searched [m]."""
_CLEAR_M = 2.9
"""Centre lines closer than this share a zone: two swept widths of 2.2 m and a margin [m]."""
CROSSING, MERGING, PARTING = 0, 1, 2
"""Kinds of zones: the lanes cross, end in the same lane, or begin in the same lane."""
RANK_MINOR, RANK_ACROSS, RANK_KERB, RANK_STRAIGHT = 0, 1, 2, 3
"""Ranks of junction lanes, the higher goes first: behind a sign, turning across the oncoming traffic, turning
to the kerb's side, straight on."""
STOP_LINE_M = 1.0
"""Where no signal says so, drivers stop this far before the junction [m]."""
TURN_RAD = 0.5
"""Change of heading from which a junction lane is a turn [rad]."""
_NEAR_JUNCTION_M = 12.0
"""A sign this close to a lane's end belongs to the junction there [m]."""


class Zones:
    """Zones that lanes share with others, Z rows."""

    other: Index
    """The other lane."""
    kind: Index
    """CROSSING, MERGING or PARTING."""
    enter_m: Array
    """Station of this lane at which the zone begins [m]."""
    leave_m: Array
    """Station of this lane at which it ends [m]."""
    other_enter_m: Array
    """Station of the other lane at which the zone begins [m]."""
    other_leave_m: Array
    """Station of the other lane at which it ends [m]."""


class Rules(NamedTuple):
    """Rules by lane, from signs and signals."""

    rank: Index
    """Rank of each junction lane, (N,)."""
    stop_m: Array
    """Station at which a driver stops before the junction [m], (N,)."""
    stop_sign: Flags
    """Junction lanes behind a stop sign, (N,)."""
    heads: list[list[int]]
    """Numbers of the signal heads that each lane obeys."""


def find_zones(network: LaneNetwork, junction: Index, after: Links, before: Links) -> tuple[Index, Zones]:
    """First row of each lane (N + 1,), and all zones that two lanes of one junction share."""
    members: dict[int, list[int]] = defaultdict(list)
    for lane in np.flatnonzero(junction >= 0).tolist():
        members[int(junction[lane])].append(lane)
    rows: list[list[_Row]] = [[] for _ in junction]
    for lanes in members.values():
        for a, row in _zones_of(network, after, before, lanes):
            rows[a].append(row)
    return packed(Zones, rows)


def _zones_of(
    network: LaneNetwork, after: Links, before: Links, lanes: list[int]
) -> Iterable[tuple[int, _Row]]:
    points, stations = [], []
    for lane in lanes:
        length = network.lanes[lane].length_m
        s = np.linspace(0.0, length, max(2, int(length / _SAMPLE_M) + 1))
        points.append(network.pose(np.full(len(s), lane), s).position_m)
        stations.append(s)
    trees = [point_tree(line) for line in points]
    low = np.array([line.min(axis=0) for line in points]) - _CLEAR_M
    high = np.array([line.max(axis=0) for line in points])
    apart = ((low[:, None] > high) | (low > high[:, None])).any(axis=-1)
    for a, b in np.argwhere(~apart).tolist():
        if a == b:
            continue
        near_a = np.asarray(trees[b].query(points[a])[0]) < _CLEAR_M
        near_b = np.asarray(trees[a].query(points[b])[0]) < _CLEAR_M
        if not (near_a.any() and near_b.any()):
            continue
        lane, other = lanes[a], lanes[b]
        kind = _zone_kind(after, before, lane, other)
        if kind == PARTING:
            near_a, near_b = _run_from_start(near_a), _run_from_start(near_b)
        here, there = stations[a][near_a], stations[b][near_b]
        yield lane, (other, kind, float(here[0]), float(here[-1]), float(there[0]), float(there[-1]))


def _zone_kind(after: Links, before: Links, lane: int, other: int) -> int:
    if set(before[lane]) & set(before[other]):
        return PARTING
    return MERGING if set(after[lane]) & set(after[other]) else CROSSING


def _run_from_start(near: Flags) -> Flags:
    apart = np.flatnonzero(~near)
    result = near.copy()
    if len(apart) and apart[0] > 0:
        result[apart[0] :] = False
    return result


def find_rules(network: LaneNetwork, junction: Index, turn_rad: Array, after: Links, before: Links) -> Rules:
    """Signs, signals and ranks of all lanes."""
    heads: list[list[int]] = [[] for _ in network.lanes]
    length = np.array([lane.length_m for lane in network.lanes])
    stop = length - STOP_LINE_M
    for index, head in enumerate(network.signals):
        for lane, station in zip(head.lanes, head.stop_station_m, strict=True):
            stop[lane] = min(stop[lane], station)
        for lane in head.junction_lanes or head.lanes:
            heads[lane].append(index)
    minor, stopping = _signed(network, junction, after)
    for sign in network.static_signs:
        if sign.kind in ("stop", "yield"):
            for lane, station in zip(sign.lanes, sign.stop_station_m, strict=True):
                if junction[lane] < 0 and length[lane] - station < _NEAR_JUNCTION_M:
                    stop[lane] = min(stop[lane], station)
    rank = np.zeros(len(heads), np.int64)
    slower = _slower_approaches(network, junction, before)
    for lane in np.flatnonzero(junction >= 0).tolist():
        turn = network.lanes[lane].kerb_side * turn_rad[lane]
        rank[lane] = RANK_STRAIGHT if abs(turn) < TURN_RAD else RANK_KERB if turn > 0 else RANK_ACROSS
        if minor[lane] or (lane in slower and not heads[lane]):
            rank[lane] = RANK_MINOR
    return Rules(rank, np.maximum(stop, 0.0), stopping, heads)


def _signed(network: LaneNetwork, junction: Index, after: Links) -> tuple[Flags, Flags]:
    """Junction lanes behind stop or yield signs, and those behind stop signs."""
    minor = np.zeros(len(network.lanes), dtype=bool)
    stopping = minor.copy()
    for sign in network.static_signs:
        if sign.kind not in ("stop", "yield"):
            continue
        for lane in sign.lanes:
            inside = [lane] if junction[lane] >= 0 else _inside_after(junction, after, lane)
            minor[inside] = True
            stopping[inside] |= sign.kind == "stop"
    return minor, stopping


def _inside_after(junction: Index, after: Links, lane: int) -> list[int]:
    """Junction lanes that a plain lane leads to within the next few sections."""
    frontier = [lane]
    for _ in range(4):
        following = [n for m in frontier for n in after[m]]
        inside = [n for n in following if junction[n] >= 0]
        if inside:
            return inside
        frontier = following
    return []


def _slower_approaches(network: LaneNetwork, junction: Index, before: Links) -> set[int]:
    """Junction lanes whose approach is clearly slower than the fastest one: slip roads that merge."""
    fastest: dict[int, float] = defaultdict(float)
    speed: dict[int, float] = {}
    for lane in np.flatnonzero(junction >= 0).tolist():
        speed[lane] = max((network.lanes[n].speed_limit_mps for n in before[lane]), default=0.0)
        fastest[int(junction[lane])] = max(fastest[int(junction[lane])], speed[lane])
    return {lane for lane, mps in speed.items() if mps < 0.8 * fastest[int(junction[lane])]}
