"""Lane network as tables that compiled functions read: lanes, their allowed speeds, their crosswalks."""

from typing import Annotated, NamedTuple

import numpy as np

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.traffic.tables.conflict_zones import Zones, find_rules, find_zones
from carlaloc_env.traffic.tables.lane_demand import stretch_demand
from carlaloc_env.traffic.tables.lane_reachability import GoalPaths, find_goal_paths, road_ends
from carlaloc_env.traffic.tables.record_arrays import Flags, fill, packed, starts

WANTED, TAKEN = 1, 2
"""What walkers do with a crossing: they wait to cross, or they walk there or will within seconds."""
LATERAL_ACCELERATION_MPS2 = 2.9
"""Comfortable lateral acceleration in bends [m/s²]."""
COMFORT_BRAKING_MPS2 = 2.0
"""Braking on which speed tables count when they look ahead [m/s²]."""
SLOWEST_BEND_MPS = 2.5
"""Bends are never taken slower: where two arcs meet, maps hold kinks [m/s]."""
WIDE_M = 2.6
"""A lane of this width holds any vehicle [m]."""


class Crossings:
    """Pairs of a crosswalk and a lane that it crosses, C rows."""

    lane: Index
    """Number of the lane, (C,)."""
    crosswalk: Index
    """Number of the crosswalk, (C,)."""
    enter_m: Array
    """Station at which the crosswalk begins [m], (C,)."""
    leave_m: Array
    """Station at which it ends [m], (C,)."""


def find_crossings(network: LaneNetwork) -> tuple[Index, Crossings]:
    """First row of each lane (N + 1,), and all crossings of driving lanes."""
    rows: list[list[tuple[int, int, float, float]]] = [[] for _ in network.lanes]
    for number, crosswalk in enumerate(network.crosswalks):
        for lane, (enter, leave) in zip(crosswalk.lanes, crosswalk.span_m, strict=True):
            rows[lane].append((lane, number, enter, leave))
    return packed(Crossings, rows)


def allowed_speeds(network: LaneNetwork) -> Array:
    """Speed allowed at every sample of the lane tables [m/s], (R,).

    The least of the posted limit, what bends allow, and what lets one brake in comfort for the rest
    of the lane.
    """
    tables = network.tables
    bend = np.maximum(np.abs(tables.curvature_radpm), 1e-4)
    bend_mps = np.maximum(np.sqrt(LATERAL_ACCELERATION_MPS2 / bend), SLOWEST_BEND_MPS)
    allowed = np.minimum(tables.speed_limit_mps, bend_mps)
    last = tables.first + tables.count - 1
    # Backward pass: one sweep over samples of equal index before their lane's end.
    for back in range(1, int(tables.count.max())):
        long = tables.count > back
        rows = last[long] - back
        entry_mps = allowed[rows + 1]
        brake = np.sqrt(entry_mps * entry_mps + 2.0 * COMFORT_BRAKING_MPS2 * tables.step_m[long])
        allowed[rows] = np.minimum(allowed[rows], brake)
    return np.ascontiguousarray(allowed)


class Lanes:
    """Lanes of a town, N rows.

    Columns that end in ``_first`` and ``_end`` bound a lane's rows in another table: lanes after and before
    it, its samples (`row`), paths, zones, signal heads and crossings.
    """

    length_m: Array
    """Length [m]."""
    wide_m: Array
    """Station up to which the lane is wide enough for any vehicle [m]."""
    junction: Index
    """Number of the junction that a driving lane lies in, −1 = none."""
    left: Index
    """Lane to the left with the same direction, −1 = none."""
    right: Index
    """Lane to the right with the same direction, −1 = none."""
    kerb_side: Array
    """Side on which the kerb lies for its driver: −1 right, 1 left where traffic keeps to the left."""
    turn_rad: Array
    """Change of heading along the lane [rad], −π…π."""
    lasting: Flags
    """Whether one can drive for ever from here, or out of the map."""
    leaves: Flags
    """Whether one leaves the map at the lane's end."""
    stretch: Index
    """Number of the stretch between two junctions that the lane belongs to."""
    stretch_m: Array
    """Length of all lanes of that stretch together [m]."""
    demand: Array
    """How much more often drivers choose that stretch than a side street."""
    rank: Index
    """Rank of a junction lane: the higher goes first."""
    stop_m: Array
    """Station at which a driver stops before the junction [m]."""
    stop_sign: Flags
    """Whether a junction lane lies behind a stop sign."""
    after_first: Index
    after_end: Index
    before_first: Index
    before_end: Index
    row_first: Index
    row_count: Index
    row_step_m: Array
    """Spacing of the samples [m]."""
    path_first: Index
    path_end: Index
    zone_first: Index
    zone_end: Index
    head_first: Index
    head_end: Index
    crossing_first: Index
    crossing_end: Index


class Samples:
    """Samples of all lanes along their centre lines, R rows."""

    position_m: Annotated[Array, 3]
    """World [m]."""
    tangent: Annotated[Array, 3]
    """Cosine and sine of the heading, and rise per metre."""
    bank: Array
    """Rise of the road per metre to the left of the lane's direction."""
    along_m: Array
    """Distance along the road's reference line from the lane's start [m]."""
    width_m: Array
    """Width of the lane [m]."""
    allowed_mps: Array
    """Speed that limit, bends and what follows in the lane allow [m/s]."""


class Roads(NamedTuple):
    """Roads of a town: lanes, and the tables that hold their rows."""

    lane: Lanes
    """Lanes, (N,)."""
    row: Samples
    """Samples of all lanes, (R,)."""
    path: GoalPaths
    """Paths to junction lanes, (K,)."""
    zone: Zones
    """Conflict zones, (Z,)."""
    crossing: Crossings
    """Crossings of lanes and crosswalks, (C,)."""
    after: Index
    """Successors of all lanes, end to end."""
    before: Index
    """Predecessors of all lanes, end to end."""
    head: Index
    """Numbers of the signal heads that lanes obey, end to end."""
    entrance: Index
    """Lanes on which vehicles come into the map that have left it elsewhere."""


def build_roads(network: LaneNetwork, demand: Array) -> Roads:
    """Tables of a lane network.

    Args:
        network: The lanes.
        demand: Demand for each lane, as `lane_demand` gives it, (N,).
    """
    tables, links = network.tables, _Links(network)
    length = tables.length_m.astype(np.float64)
    sides = (links.junction, links.left, links.right)
    path_first, paths, lasting, leaves = find_goal_paths(
        length, *sides, links.after, links.before, links.driving
    )
    begins = road_ends(links.driving, *sides, links.before)
    entrance = np.flatnonzero(lasting & begins & leaves.any()).astype(np.int64)
    turn = _turns(network)
    rules = find_rules(network, links.junction, turn, links.after, links.before)
    zone_first, zones = find_zones(network, links.junction, links.after, links.before)
    crossing_first, crossings = find_crossings(network)
    stretch = _stretches(links)
    bounds: dict[str, Index] = {}
    for name, first in (
        ("after", starts(links.after)),
        ("before", starts(links.before)),
        ("path", path_first),
        ("zone", zone_first),
        ("head", starts(rules.heads)),
        ("crossing", crossing_first),
    ):
        bounds |= {f"{name}_first": first[:-1], f"{name}_end": first[1:]}
    lanes = fill(
        Lanes,
        len(length),
        length_m=length,
        wide_m=_wide_until(network),
        junction=links.junction,
        left=links.left,
        right=links.right,
        kerb_side=[lane.kerb_side for lane in network.lanes],
        turn_rad=turn,
        lasting=lasting,
        leaves=leaves,
        stretch=stretch,
        stretch_m=np.bincount(stretch, weights=length)[stretch],
        demand=stretch_demand(demand, stretch, length),
        rank=rules.rank,
        stop_m=rules.stop_m,
        stop_sign=rules.stop_sign,
        row_first=tables.first,
        row_count=tables.count,
        row_step_m=tables.step_m,
        **bounds,
    )
    samples = fill(
        Samples,
        len(tables.width_m),
        position_m=tables.position_m,
        tangent=tables.tangent,
        bank=network.bank,
        along_m=tables.along_m,
        width_m=tables.width_m,
        allowed_mps=allowed_speeds(network),
    )
    after, before, heads = (
        np.array([n for row in rows for n in row], np.int64)
        for rows in (links.after, links.before, rules.heads)
    )
    return Roads(lanes, samples, paths, zones, crossings, after, before, heads, entrance)


class _Links:
    """Neighbours, successors and predecessors of driving lanes."""

    def __init__(self, network: LaneNetwork) -> None:
        lanes = network.lanes
        driving = [lane.type == "driving" for lane in lanes]
        self.driving = np.array(driving, dtype=bool)
        self.after = [[n for n in lane.successors if driving[n] and driving[lane.index]] for lane in lanes]
        self.before = [[n for n in lane.predecessors if driving[n] and driving[lane.index]] for lane in lanes]
        names = [lane.junction_id for lane in lanes]
        number = {name: k for k, name in enumerate(dict.fromkeys(names))}
        inside = [drives and name is not None for drives, name in zip(driving, names, strict=True)]
        self.junction = np.where(inside, [number[name] for name in names], -1).astype(np.int64)
        self.left = np.array([-1 if lane.left is None else lane.left for lane in lanes], np.int64)
        self.right = np.array([-1 if lane.right is None else lane.right for lane in lanes], np.int64)


def _wide_until(network: LaneNetwork) -> Array:
    """Last station of each lane that is `WIDE_M` wide [m]; half the length of lanes that never are."""
    tables = network.tables
    row = np.arange(len(tables.width_m)) - np.repeat(tables.first, tables.count)
    last = np.maximum.reduceat(np.where(tables.width_m >= WIDE_M, row, -1), tables.first)
    result: Array = np.where(last < 0, 0.5 * tables.length_m, last * tables.step_m)
    return result


def _stretches(links: _Links) -> Index:
    """Numbers of stretches: driving lanes joined by links and lane changes without a junction between."""
    number = np.arange(len(links.junction), dtype=np.int64)
    for lane in range(len(number)):
        if links.junction[lane] >= 0 or number[lane] != lane:
            continue
        queue = [lane]
        while queue:
            current = queue.pop()
            number[current] = lane
            beside = int(links.left[current]), int(links.right[current])
            near = (*links.after[current], *links.before[current], *beside)
            queue += [n for n in near if n > lane and links.junction[n] < 0 and number[n] == n]
    return number


def _turns(network: LaneNetwork) -> Array:
    tables = network.tables
    change = tables.heading_rad[tables.first + tables.count - 1] - tables.heading_rad[tables.first]
    result: Array = np.mod(change + np.pi, 2.0 * np.pi) - np.pi
    return result
