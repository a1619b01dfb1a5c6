"""Lanes of different roads that lie on each other outside any junction: one vehicle at a time there.

Generated maps let roads run into each other where no junction gives a right of way. Drivers then do as at
a narrow stretch of road: the first goes on, the others wait before it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.jit import compiled
from carlaloc_env.core.point_tree import point_tree
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.traffic.tables.conflict_zones import Links
from carlaloc_env.traffic.tables.lane_geometry import station_beside
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.occupancy import Occupancy, on_origin
from carlaloc_env.traffic.tables.record_arrays import Flags, columns, fill, starts
from carlaloc_env.traffic.tables.vehicle_state import PAST, PLAN, STANDING_MPS, Drivers, Fleet

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

NEAR_M = 2.3
"""Lanes whose centre lines come closer than this cannot both be driven: about a vehicle's width [m]."""
CLEAR_M = 2.9
"""No other vehicle may be where the centre lines are closer than this [m]."""
_SHORTEST_M = 3.0
"""Shorter pieces are corners that touch [m]."""
_ONWARD_M = 15.0
"""Lanes that follow each other within this distance are one path [m]."""
_RANGE_M = 20.0
"""Distance to a shared piece from which on vehicles watch it [m]."""
_RANGE_S = 4.0
"""Further distance in driving time [s]."""
_STOP_BEFORE_M = 1.5
"""Gap to a shared piece before which vehicles stop [m]."""
_PIECE_ROOM_M = 2.0
"""Pieces with less room between them, beside the vehicle's length, are entered as one [m]."""
_BRAKES_FIRST_MPS2 = 3.5
"""A vehicle that would have to brake harder goes first [m/s²]."""
_EGO_RANGE_S = 2.0
"""Driving time ahead within which shared pieces are kept free for the ego [s]."""
_PATIENCE = 0.2
"""How much sooner a waiting vehicle counts as arriving, per second of waiting."""
_STUCK_S = 60.0
"""A vehicle that has waited longer goes before a vehicle that stands in the piece [s]."""
_ROWS = 2048
"""Rows that are made for approaches at first."""


class SharedPieces:
    """Pieces of lanes that another lane lies on, P rows, each pair twice."""

    enter_m: Array
    """Station of the lane at which it begins [m]."""
    leave_m: Array
    """Station at which it ends [m]."""
    twin: Index
    """Row of the same piece as seen from the other lane."""


class Overlaps(NamedTuple):
    """All shared pieces by lane."""

    first: Index
    """Where each lane's rows begin, (N + C,)."""
    piece: SharedPieces


class ApproachRows:
    """Vehicles that are in a shared piece or come up to it."""

    row: Index
    """Row of the piece."""
    vehicle: Index
    to_enter_m: Array
    """From the front to the piece, or to the first of a group of pieces, not above 0 inside [m]."""


class Approaches(NamedTuple):
    """All approaches to shared pieces in one step."""

    entry: ApproachRows
    """Rows; the first ``used[0]`` are in use."""
    halt_m: Array
    """Where each vehicle has to stop for others, from its front [m], inf = nowhere, (N,)."""
    used: Index
    """Number of approaches, (1,); above the number of rows when there was no room for all."""


def empty_approaches(vehicles: int, rows: int = _ROWS) -> Approaches:
    """Room for the approaches of a number of vehicles, N, in so many rows at first."""
    return Approaches(columns(ApproachRows, rows), np.full(vehicles, np.inf), np.zeros(1, np.int64))


def find_overlaps(network: LaneNetwork, driving: Flags, junction: Index, after: Links) -> Overlaps:
    """Pieces of driving lanes of different roads that lie on each other at the same level.

    Lanes of one junction have their own zones, and lanes that follow each other do not count.
    """
    tables = network.tables
    owner = np.repeat(np.arange(len(tables.count)), tables.count)
    rows = np.flatnonzero(driving[owner])
    tree = point_tree(tables.position_m[rows])
    near = _pairs(network, owner[rows], tree, NEAR_M, junction)
    onward = {a: _onward(network, after, a) for a in set(near[:, :2].ravel().tolist())}
    pairs = {(a, b) for a, b in near[:, :2].tolist() if b not in onward[a] and a not in onward[b]}
    pieces_of: list[list[tuple[float, float, tuple[int, int]]]] = [[] for _ in network.lanes]
    wide = _pairs(network, owner[rows], tree, CLEAR_M, junction) if pairs else near
    for a, b in sorted(pairs):
        both = wide[(wide[:, 0] == a) & (wide[:, 1] == b)]
        at_a, at_b = (
            (rows[both[:, 2 + k]] - tables.first[lane]) * tables.step_m[lane] for k, lane in enumerate((a, b))
        )
        if min(np.ptp(at_a), np.ptp(at_b)) < _SHORTEST_M:
            continue
        pieces_of[a].append((float(at_a.min()), float(at_a.max()), (a, b)))
        pieces_of[b].append((float(at_b.min()), float(at_b.max()), (b, a)))
    flat = [piece for pieces in pieces_of for piece in sorted(pieces)]
    number = {key: k for k, (_, _, key) in enumerate(flat)}
    piece = fill(
        SharedPieces,
        len(flat),
        enter_m=[enter for enter, _, _ in flat],
        leave_m=[leave for _, leave, _ in flat],
        twin=[number[key[::-1]] for _, _, key in flat],
    )
    return Overlaps(starts(pieces_of), piece)


def _pairs(network: LaneNetwork, owner: Index, tree: cKDTree, range_m: float, junction: Index) -> Index:
    """Lanes a < b of different roads and junctions, and the samples (by number) that are near, (K, 4)."""
    samples = tree.query_pairs(range_m, output_type="ndarray")
    a, b = owner[samples[:, 0]], owner[samples[:, 1]]
    samples = np.where((a > b)[:, None], samples[:, ::-1], samples)
    a, b = owner[samples[:, 0]], owner[samples[:, 1]]
    road = np.unique([lane.road_id for lane in network.lanes], return_inverse=True)[1]
    apart = (road[a] != road[b]) & ((junction[a] != junction[b]) | (junction[a] < 0))
    result: Index = np.column_stack([a, b, samples])[apart]
    return result


def _onward(network: LaneNetwork, after: Links, lane: int) -> set[int]:
    """Lanes that begin within a short distance behind a lane's end."""
    lanes: set[int] = set()
    waiting = [(lane, 0.0)]
    while waiting:
        here, distance_m = waiting.pop()
        for n in after[here]:
            if n not in lanes:
                lanes.add(n)
                if distance_m + network.lanes[n].length_m < _ONWARD_M:
                    waiting.append((n, distance_m + network.lanes[n].length_m))
    return lanes


@compiled
def yield_at_overlaps(approaches: Approaches, overlaps: Overlaps, fleet: Fleet) -> None:
    """Stop before shared pieces that another vehicle is in, or will be in sooner; change no lanes there.

    Args:
        approaches: Those of this step, as `gather_approaches` left them.
        overlaps: All shared pieces.
        fleet: State (N + C,); `stop_gap_m` and `indicated_s` are written.
    """
    if len(overlaps.piece.twin) == 0:
        return
    for k in range(approaches.used[0]):
        v = approaches.entry.vehicle[k]
        if fleet.is_ego[v]:
            continue
        fleet.indicated_s[v] = 0.0
        if approaches.entry.to_enter_m[k] <= 0.0:
            continue
        twin = overlaps.piece.twin[approaches.entry.row[k]]
        for j in range(approaches.used[0]):
            if approaches.entry.row[j] != twin or approaches.entry.vehicle[j] == v:
                continue
            if _has_priority(fleet, approaches.entry, j, k):
                gap = max(approaches.entry.to_enter_m[k] - _STOP_BEFORE_M, 0.0)
                approaches.halt_m[v] = min(approaches.halt_m[v], gap)
    for v in range(len(fleet.speed_mps)):
        if fleet.is_ego[v]:
            break
        fleet.stop_gap_m[v] = min(fleet.stop_gap_m[v], approaches.halt_m[v])
        approaches.halt_m[v] = np.inf


@compiled
def gather_approaches(
    approaches: Approaches,
    overlaps: Overlaps,
    occupancy: Occupancy,
    roads: Roads,
    drivers: Drivers,
    fleet: Fleet,
    count: int,
) -> None:
    """Gather vehicles in shared pieces or coming up to them: along plans, with tails, and the egos.

    Writes the rows of `approaches` from 0 on and their number.
    """
    approaches.used[0] = 0
    if len(overlaps.piece.twin) == 0:
        return
    for v in range(count):
        half = 0.5 * drivers.length_m[v]
        range_m = _RANGE_M + _RANGE_S * fleet.speed_mps[v]
        begins, begun, ends = -fleet.station_m[v], -np.inf, -np.inf
        behind = 0
        while behind < PAST and fleet.past[v, behind] >= 0:
            begins -= roads.lane.length_m[fleet.past[v, behind]]
            behind += 1
        for k in range(-behind, PLAN):
            lane = fleet.past[v, -k - 1] if k < 0 else fleet.plan[v, k]
            if lane < 0 or begins - half > range_m:
                break
            begun, ends = _add_lane(approaches, overlaps, v, lane, begins, half, range_m, begun, ends)
            begins += roads.lane.length_m[lane]
        side, lane = fleet.origin[v], fleet.plan[v, 0]
        if side != 0 and on_origin(roads, drivers, fleet, v):
            old = roads.lane.left[lane] if side > 0 else roads.lane.right[lane]
            if old >= 0:
                begins = -station_beside(roads, lane, fleet.station_m[v], old)
                _add_lane(approaches, overlaps, v, old, begins, half, 0.0, -np.inf, -np.inf)
    for k in range(occupancy.used[0]):
        owner = occupancy.body.owner[k]
        if fleet.is_ego[owner]:
            range_m = _EGO_RANGE_S * occupancy.body.speed_mps[k]
            lane, begins = occupancy.body.lane[k], -occupancy.body.centre_m[k]
            half = occupancy.body.half_m[k]
            _add_lane(approaches, overlaps, owner, lane, begins, half, range_m, -np.inf, -np.inf)


@compiled
def _add_lane(
    approaches: Approaches,
    overlaps: Overlaps,
    v: int,
    lane: int,
    begins_m: float,
    half_m: float,
    range_m: float,
    begun_m: float,
    ends_m: float,
) -> tuple[float, float]:
    """Note a vehicle at the pieces of a lane that begins so far ahead of its centre.

    Pieces between which it would not find room are entered as one, with the first of them: else two
    vehicles could each stand in a piece that the other needs.

    Returns:
        Where the last of such groups of pieces begins and ends, ahead of the centre [m].
    """
    for row in range(overlaps.first[lane], overlaps.first[lane + 1]):
        enter, leave = begins_m + overlaps.piece.enter_m[row], begins_m + overlaps.piece.leave_m[row]
        if enter > ends_m + 2.0 * half_m + _PIECE_ROOM_M:
            begun_m, ends_m = enter, leave
        ends_m = max(ends_m, leave)
        k = approaches.used[0]
        if begun_m - half_m > range_m or leave + half_m < 0.0:
            continue
        if k < len(approaches.entry.row):
            approaches.entry.row[k], approaches.entry.vehicle[k] = row, v
            approaches.entry.to_enter_m[k] = begun_m - half_m
        approaches.used[0] = k + 1
    return begun_m, ends_m


@compiled
def _has_priority(fleet: Fleet, entry: ApproachRows, j: int, k: int) -> bool:
    """Whether approach j passes a shared piece before approach k, which is still outside."""
    h, v = entry.vehicle[j], entry.vehicle[k]
    h_distance, distance = entry.to_enter_m[j], entry.to_enter_m[k]
    if h_distance <= 0.0 or fleet.is_ego[h]:
        return not (fleet.waited_s[v] > _STUCK_S and fleet.speed_mps[h] < STANDING_MPS)
    h_speed, speed = fleet.speed_mps[h], fleet.speed_mps[v]
    # A vehicle that stands farther off for another reason does not come.
    led = fleet.leader[h] >= 0 and fleet.leader[h] != v and fleet.gap_m[h] < h_distance
    if h_speed < STANDING_MPS and (fleet.stop_gap_m[h] < h_distance - 1.5 or led):
        return False
    h_must = h_speed * h_speed > 2.0 * _BRAKES_FIRST_MPS2 * max(h_distance - _STOP_BEFORE_M, 0.01)
    must = speed * speed > 2.0 * _BRAKES_FIRST_MPS2 * max(distance - _STOP_BEFORE_M, 0.01)
    if h_must != must:
        return bool(h_must)
    h_comes = h_distance / max(h_speed, 1.0) - _PATIENCE * fleet.waited_s[h]
    comes = distance / max(speed, 1.0) - _PATIENCE * fleet.waited_s[v]
    return bool(h_comes < comes or (h_comes == comes and h < v))
