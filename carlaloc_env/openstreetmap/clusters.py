"""Junctions: nodes too close for roads between them become one, and every leg ends where it is free."""

from __future__ import annotations

import heapq
import itertools
import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely

from carlaloc_env.authoring.geometry.plan_view_curves import wrap
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.polylines import distance_along
from carlaloc_env.openstreetmap.road_graph import Chain
from carlaloc_env.openstreetmap.tags import Street

LEAST_M = 4.0
"""Least distance from a node to the end of a leg [m]."""
CHANGE_M = 14.0
"""The same where only the number of lanes changes."""
ROAD_M = 4.0
"""Shortest road between two junctions [m]."""
SWALLOWED_M, SLOW_SWALLOWED_M = 60.0, 24.0
"""Longer roads, fast and other ones, are never part of a junction [m]."""
WIDEST_M = 75.0
"""Largest extent of a junction's nodes [m]."""
TURN_M = 7.8
"""Radius sought for the middle of a turning lane, so that rear wheels stay off kerbs [m]."""
FARTHEST_M = 40.0
"""Turns are made wider until legs end this far from their node [m]."""
REACH_M, SLOW_REACH_M, OVERLAP_M = 130.0, 24.0, 70.0
"""How far legs may end from their node, on fast and other streets, and where lanes overlap [m]."""
SHARP_RAD = math.radians(112.0)
"""Sharper turns make no junction larger: they are left out where they do not fit."""
FAST_RANK = 4
"""Rank of fast streets."""
GAP_M = 0.6
"""Distance of the carriageways of two legs where they end [m]."""
_FACING = math.radians(140.0)
_STEP_M = 1.0
_BEND = 0.71
"""Least radius of a bend with clothoids in that of an arc with the same tangents."""


@dataclass(slots=True)
class End:
    """One end of a chain at a junction."""

    chain: int
    side: int
    """0: the chain begins here, 1: it ends here."""
    node: int
    line: Array
    """Points (N, 2) of the chain, away from the junction [m]."""
    half_m: float
    """Half the width of its carriageway [m]."""
    enters: bool
    """Whether traffic comes from it into the junction."""
    leaves: bool
    """Whether traffic goes from the junction into it."""
    street: Street
    setback_m: float = LEAST_M

    def at(self, s: float) -> tuple[float, float, float]:
        """Point [m] and heading [rad] away from the junction, at a distance along the line."""
        steps = distance_along(self.line)
        (x, p), (y, q) = (np.interp([s, s + 4.0], steps, values).tolist() for values in self.line.T)
        if math.hypot(p - x, q - y) < 0.5:
            (x0, y0), (p, q) = self.line[-2:]
            return x, y, math.atan2(q - y0, p - x0)
        return x, y, math.atan2(q - y, p - x)


@dataclass(slots=True)
class Cluster:
    """One junction, or the end of a street."""

    nodes: set[int]
    ends: list[End] = field(default_factory=list)
    inner: list[int] = field(default_factory=list)
    """Chains that lie inside."""


def half_width(street: Street) -> float:
    """Half the width of a carriageway with its gutters [m]."""
    return 0.5 * sum(street.lanes) * street.lane_m + 0.3 + street.bike_m


def find_clusters(chains: Sequence[Chain], more: Mapping[tuple[int, int], float]) -> list[Cluster]:
    """Junctions with the setbacks of all their legs.

    Args:
        chains: Streets.
        more: What single ends, by chain and side, need beyond the usual setback [m].
    """
    inner: set[int] = set()
    parent: dict[int, int] = {node: node for chain in chains for node in (chain.nodes[0], chain.nodes[-1])}
    places = {
        node: chain.line[k] for chain in chains for node, k in ((chain.nodes[0], 0), (chain.nodes[-1], -1))
    }

    def root(node: int) -> int:
        while parent[node] != node:
            node = parent[node]
        return node

    def swallow(k: int) -> bool:
        a, b = (root(chains[k].nodes[end]) for end in (0, -1))
        members = [places[node] for node in parent if root(node) in (a, b)]
        if a != b and float(np.ptp(np.array(members), axis=0).max()) > WIDEST_M:
            return False
        parent[max(a, b)] = min(a, b)
        inner.add(k)
        return True

    for k, chain in enumerate(chains):
        if chain.length_m < 2 * LEAST_M + ROAD_M:
            swallow(k)
    group_of: dict[tuple[int, ...], Cluster] = {}
    while True:
        clusters = []
        for group in _groups(chains, inner, root):
            key = (*sorted(group.nodes), *sorted(group.inner))
            if key not in group_of:
                group_of[key] = group
                _set_back(group, chains)
                for end in group.ends:
                    end.setback_m += more.get((end.chain, end.side), 0.0)
            clusters.append(group_of[key])
        setback = {(end.chain, end.side): end.setback_m for c in clusters for end in c.ends}
        short = []
        for k, chain in enumerate(chains):
            if k not in inner:
                lacks = setback[k, 0] + setback[k, 1] + ROAD_M - chain.length_m
                if lacks > 0:
                    short.append((chain.length_m, k))
        changed = False
        for length, k in sorted(short):
            one = root(chains[k].nodes[0]) == root(chains[k].nodes[-1])
            fast = chains[k].street.rank >= FAST_RANK
            longest = SWALLOWED_M if fast else SLOW_SWALLOWED_M
            changed = ((one or length <= longest) and swallow(k)) or changed
        for k, chain in enumerate(chains):
            # Beside the turns of a junction there is no room for a street of its own.
            one = root(chain.nodes[0]) == root(chain.nodes[-1])
            if k not in inner and one and chain.length_m <= SWALLOWED_M:
                changed = swallow(k) or changed
        if not changed:
            _shrink(clusters, chains)
            return clusters


def _groups(chains: Sequence[Chain], inner: set[int], root: Callable[[int], int]) -> list[Cluster]:
    """Junctions of the nodes that have one root, their ends not yet set back."""
    cluster_of: dict[int, Cluster] = defaultdict(lambda: Cluster(set()))
    for k, chain in enumerate(chains):
        for side, at in ((0, 0), (1, -1)):
            home = cluster_of[root(chain.nodes[at])]
            home.nodes.add(chain.nodes[at])
            if k not in inner:
                line, street = chain.line if side == 0 else chain.line[::-1], chain.pieces[at].street
                enters, leaves = not chain.oneway or side == 1, not chain.oneway or side == 0
                home.ends.append(
                    End(k, side, chain.nodes[at], line, half_width(street), enters, leaves, street)
                )
        if k in inner:
            cluster_of[root(chain.nodes[0])].inner.append(k)
    return [cluster_of[home] for home in sorted(cluster_of)]


def _set_back(cluster: Cluster, chains: Sequence[Chain]) -> None:
    """Ends of the legs: apart from each other, and far enough for turns."""
    ends = cluster.ends
    if len(ends) == 1:
        ends[0].setback_m = 0.0
        return
    lengths = [chains[end.chain].length_m for end in ends]
    if len(ends) == 2 and not cluster.inner:
        usual = LEAST_M if ends[0].node in chains[ends[0].chain].lit else CHANGE_M
        for end, length in zip(ends, lengths, strict=True):
            end.setback_m = max(LEAST_M, min(usual, 0.5 * length - ROAD_M))
    for end, other in itertools.combinations(ends, 2):
        _apart(end, other)
    for _ in range(14):
        grown = set()
        for a, b in reachable(cluster, chains):
            if turn_radius(a, b) < TURN_M:
                grown |= {id(a), id(b)}
        for end, length in zip(ends, lengths, strict=True):
            if id(end) in grown and end.setback_m < min(FARTHEST_M, length):
                end.setback_m += 1.5
        if not grown:
            break


def _apart(a: End, b: End) -> None:
    """Move both ends away until their carriageways do not meet."""
    limits = [float(shapely.LineString(e.line).length) for e in (a, b)]
    fast = max(a.street.rank, b.street.rank) >= FAST_RANK
    usual = REACH_M if fast else SLOW_REACH_M
    reach = min(max(usual, OVERLAP_M), *limits)
    if reach < 1.0:
        return
    s = np.arange(0.0, reach, _STEP_M)
    lines = [shapely.LineString(e.line) for e in (a, b)]
    headings = [e.at(min(12.0, 0.5 * limit))[2] for e, limit in zip((a, b), limits, strict=True)]
    if a.node == b.node and abs(wrap(headings[0] - headings[1])) > _FACING:
        return
    least = a.half_m + b.half_m + GAP_M
    for end, own, other in ((a, lines[0], lines[1]), (b, lines[1], lines[0])):
        near = shapely.distance(shapely.line_interpolate_point(own, s), other)
        # Carriageways side by side never part: they end where they are as far apart as they will be.
        bound = min(least, float(near[s <= usual][-8:].min()) - 0.4)
        # Farther out it is enough that lanes do not lie on each other.
        far_bound = min(least - GAP_M - 1.0, float(near[-8:].min()) - 0.4)
        close = np.flatnonzero(near < np.where(s <= usual, bound, far_bound))
        if len(close):
            end.setback_m = max(end.setback_m, float(s[close[-1]]) + 1.5)


def reachable(cluster: Cluster, chains: Sequence[Chain]) -> list[tuple[End, End]]:
    """Pairs of legs between which the streets inside lead."""
    onward: dict[int, set[int]] = defaultdict(set)
    for k in cluster.inner:
        first, last = chains[k].nodes[0], chains[k].nodes[-1]
        onward[first].add(last)
        if not chains[k].oneway:
            onward[last].add(first)
    pairs = []
    for a in cluster.ends:
        if not a.enters:
            continue
        seen, todo = {a.node}, [a.node]
        while todo:
            fresh = onward[todo.pop()] - seen
            seen |= fresh
            todo += fresh
        pairs += [
            (a, b) for b in cluster.ends
            if b.leaves and b.node in seen and (b.chain, b.side) != (a.chain, a.side)
        ]  # fmt: skip
    return pairs


def turn_radius(a: End, b: End) -> float:
    """About the radius of the middle of the inner lane from one leg to another [m]; large for no turn."""
    x0, y0, h0 = a.at(a.setback_m)
    x1, y1, h1 = b.at(b.setback_m)
    h0 = wrap(h0 + math.pi)
    turn = wrap(h1 - h0)
    if abs(turn) < math.radians(20.0) or abs(turn) > SHARP_RAD:
        return 1e9
    # Distances of the left border of the lane that turns from the middles of both carriageways.
    rights = []
    for end, enters in ((a, True), (b, False)):
        lanes, lane = end.street.lanes, end.street.lane_m
        count = lanes[0] if (end.side == 1) == enters else lanes[1]
        rights.append(0.5 * sum(lanes) * lane - (1 if turn < 0 else count) * lane)
    x0, y0 = x0 + rights[0] * math.sin(h0), y0 - rights[0] * math.cos(h0)
    x1, y1 = x1 + rights[1] * math.sin(h1), y1 - rights[1] * math.cos(h1)
    behind = (-(x1 - x0) * math.sin(h0) + (y1 - y0) * math.cos(h0)) / math.sin(turn)
    ahead = (x1 - x0) * math.cos(h0) + (y1 - y0) * math.sin(h0) - behind * math.cos(turn)
    lane = min(a.street.lane_m, b.street.lane_m)
    return _BEND * min(ahead, behind) / math.tan(abs(turn) / 2) + math.copysign(0.5 * lane, turn)


def _shrink(clusters: Iterable[Cluster], chains: Sequence[Chain]) -> None:
    """Where a road is too short for both its setbacks, they share it."""
    ends: dict[int, list[End]] = defaultdict(list)
    for cluster in clusters:
        for end in cluster.ends:
            ends[end.chain].append(end)
    for k, both in ends.items():
        room = chains[k].length_m - ROAD_M
        asked = sum(end.setback_m for end in both)
        if asked > room:
            for end in both:
                end.setback_m *= max(room, 0.0) / asked


def route_inside(cluster: Cluster, chains: Sequence[Chain], a: End, b: End) -> Array:
    """Points (N, 2) from leg a's node to leg b's node along the streets inside [m]."""
    steps: dict[int, list[tuple[int, Array, float]]] = {}
    for k in cluster.inner:
        chain = chains[k]
        first, last, length = chain.nodes[0], chain.nodes[-1], chain.length_m
        steps.setdefault(first, []).append((last, chain.line, length))
        if not chain.oneway:
            steps.setdefault(last, []).append((first, chain.line[::-1], length))
    queue: list[tuple[float, int, int, Array]] = [(0.0, 0, a.node, a.line[:1])]
    done: set[int] = set()
    ticket = itertools.count(1)
    while queue:
        way, _, node, line = heapq.heappop(queue)
        if node == b.node:
            return line
        if node in done:
            continue
        done.add(node)
        for onward, points, length in steps.get(node, ()):
            heapq.heappush(queue, (way + length, next(ticket), onward, np.concatenate([line, points[1:]])))
    return a.line[:1]
