"""The streets of an extract as chains between junctions: those on which one can drive for ever."""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import MapError
from carlaloc_env.core.polylines import distance_along
from carlaloc_env.openstreetmap.elements import Way
from carlaloc_env.openstreetmap.extract import Extract
from carlaloc_env.openstreetmap.tags import Street, direction, for_cars, signed_nodes
from carlaloc_env.openstreetmap.turning_places import (
    FIRST_ID,
    Segment,
    TurningPlaces,
    directed,
    lengths,
    longest,
    parts,
)

PART_LEAST_M = 80.0
"""Parts of the streets that are shorter and apart from the rest are left out [m]."""
TURN_BACK_M, TURNED_BACK = 20.0, -0.65
"""A one-way street turns back if the directions so far before and behind its apex [m] have this cosine."""
PART_M = 30.0
"""Parts of a street with other numbers of lanes that are shorter are built like their neighbours [m]."""
BLOCK_M = 45.0
"""Lit crossings so far from a junction and from each other have lights of their own [m]."""


@dataclass(slots=True)
class Piece:
    """Part of a chain that is one way: from one of the chain's nodes to a later one."""

    street: Street
    way: int
    first: int
    last: int


@dataclass(slots=True)
class Chain:
    """A street between two junctions or ends; one-way ones run along their nodes."""

    nodes: list[int]
    line: Array
    """World points (N, 2) of the nodes [m]."""
    pieces: list[Piece]
    lit: frozenset[int] = frozenset()
    """Ends that are lit crossings."""

    @property
    def oneway(self) -> bool:
        """Whether no traffic runs against the nodes."""
        return self.pieces[0].street.oneway

    @property
    def stations_m(self) -> Array:
        """Distance of every node from the first one [m], (N,)."""
        return distance_along(self.line)

    @property
    def length_m(self) -> float:
        """Length of the line [m]."""
        return float(np.hypot(*np.diff(self.line, axis=0).T).sum())

    @property
    def street(self) -> Street:
        """The street of its longest part."""
        s = self.stations_m
        return max(self.pieces, key=lambda p: float(s[p.last] - s[p.first])).street


@dataclass(slots=True)
class RoadGraph:
    """Chains between junctions, and what was left out."""

    chains: list[Chain]
    turning_m: float = 0.0
    """Length of turning places, which the extract has not [m]."""
    left_out: dict[int, str] = field(default_factory=dict)
    """Ids of ways that cars use but that are not built, and why."""
    kept_m: float = 0.0
    """Length of those that are built [m]."""
    asked_m: float = 0.0
    """Length of all streets for cars [m]."""


def build_graph(extract: Extract, street_of: Callable[[Way], Street]) -> RoadGraph:
    """Chains of all streets that can be reached from each other.

    Raises:
        MapError: There is none.
    """
    segments: list[Segment] = []
    for way in extract.ways.values():
        if for_cars(way):
            nodes = way.nodes[::-1] if direction(way.tags) < 0 else way.nodes
            segments += [(u, v, way) for u, v in itertools.pairwise(nodes) if u != v]
    if not segments:
        raise MapError(f"{extract.source} has no street for cars here; give a box with streets")
    whole = _opened(segments, extract)
    kept = _joined(whole, extract)
    more = [(u, v, way) for way in TurningPlaces(kept, extract).join()
            for u, v in itertools.pairwise(way.nodes)]  # fmt: skip
    kept = _longest([*kept, *more], extract)
    own = [s for s in kept if s[2].id > FIRST_ID]
    if _length(own, extract) < 60.0:
        raise MapError(
            f"{extract.source} has no streets here on which one could drive for ever; give a larger box"
        )
    return RoadGraph(
        chains=_chains(kept, extract, street_of),
        asked_m=_length(whole, extract),
        kept_m=_length(own, extract),
        turning_m=_length(kept, extract) - _length(own, extract),
        left_out=_left_out(whole, own, extract),
    )


def _joined(segments: Sequence[Segment], extract: Extract) -> list[Segment]:
    """Streets without those that meet no others here and are short."""
    part = parts([(u, v) for u, v, _ in segments], "weak")
    length_m = lengths(segments, part, extract.xy_m)
    least = min(PART_LEAST_M, max(length_m.values()))
    return [s for s in segments if length_m[part[s[0]]] >= least]


def _longest(segments: Sequence[Segment], extract: Extract) -> list[Segment]:
    """Segments of the longest part in which every place can be reached from every other."""
    part = parts(directed(segments), "strong")
    best = longest(segments, part, extract.xy_m)
    return [s for s in segments if part[s[0]] == best == part[s[1]]]


def _left_out(segments: Sequence[Segment], kept: Sequence[Segment], extract: Extract) -> dict[int, str]:
    """Ways that are not built, or not along all their length, and why."""
    built = {(u, v, way.id) for u, v, way in kept}
    lost: dict[int, float] = defaultdict(float)
    for u, v, way in segments:
        if (u, v, way.id) not in built:
            lost[way.id] += math.dist(extract.xy_m[u], extract.xy_m[v])
    why = "which no other street leads to and back from"
    return {way: f"{metres:.0f} m, {why}" for way, metres in lost.items() if metres > 1.0}


def _opened(segments: Sequence[Segment], extract: Extract) -> list[Segment]:
    """One-way streets that turn back more tightly than a road can, cut where they do."""
    into: dict[int, list[int]] = defaultdict(list)
    out_of: dict[int, list[int]] = defaultdict(list)
    for k, (u, v, way) in enumerate(segments):
        for a, b in ((u, v), (v, u))[: 1 if direction(way.tags) else 2]:
            into[b].append(k)
            out_of[a].append(k)

    def reached(node: int, onward: Mapping[int, list[int]], end: int) -> Array:
        """About where one is TURN_BACK_M before or behind a node."""
        place, far = np.array(extract.xy_m[node]), 0.0
        while far < TURN_BACK_M and len(into[node]) == len(out_of[node]) == 1:
            node = segments[onward[node][0]][:2][end]
            ahead = np.array(extract.xy_m[node])
            step = float(np.hypot(*(ahead - place)))
            place = place + (ahead - place) * min(1.0, (TURN_BACK_M - far) / max(step, 1e-9))
            far += step
        return place

    result, opened = list(segments), [np.full(2, np.inf)]
    for node, arriving in list(into.items()):
        leaving = out_of[node]
        at = np.array(extract.xy_m[node])
        apart = min(float(np.hypot(*(at - other))) for other in opened) > TURN_BACK_M
        if len(arriving) == len(leaving) == 1 and arriving != leaving and apart:
            step, onward = at - reached(node, into, 0), reached(node, out_of, 1) - at
            if float((step * onward).sum()) < TURNED_BACK * float(np.hypot(*step) * np.hypot(*onward)):
                _, v, way = segments[leaving[0]]
                opened.append(at)
                fresh = FIRST_ID - 500_000 - len(extract.xy_m)
                extract.xy_m[fresh] = extract.xy_m[node]
                result[leaving[0]] = (fresh, v, way)
    return result


def _length(segments: Iterable[Segment], extract: Extract) -> float:
    return math.fsum(math.dist(extract.xy_m[u], extract.xy_m[v]) for u, v, _ in segments)


def _chains(segments: Sequence[Segment], extract: Extract, street_of: Callable[[Way], Street]) -> list[Chain]:
    """Segments joined where two of one kind meet."""
    at: dict[int, list[int]] = defaultdict(list)
    for k, (u, v, _) in enumerate(segments):
        at[u].append(k)
        at[v].append(k)
    through = {node for node, around in at.items() if _goes_on(node, around, segments)}
    used: set[int] = set()
    chains = []
    starts = [k for k, (u, v, _) in enumerate(segments) if u not in through or v not in through]
    for first in [*starts, *range(len(segments))]:
        if first in used:
            continue
        u, v, _ = segments[first]
        if direction(segments[first][2].tags) == 0 and u in through:
            u, v = v, u
        elif u in through and first in starts:
            continue  # A one-way street that is reached from its beginning.
        chains.append(_walk(first, u, segments, at, through, used, extract, street_of))
    cut = [part for chain in chains for piece in _by_lanes(chain) for part in _at_lights(piece, extract)]
    # A ring that begins and ends at one junction is cut in its middle.
    rings = [chain.nodes[0] == chain.nodes[-1] and len(chain.nodes) > 3 for chain in cut]
    return [part for chain, ring in zip(cut, rings, strict=True)
            for part in (_split(chain, [len(chain.nodes) // 2]) if ring else [chain])]  # fmt: skip


def _by_lanes(chain: Chain) -> list[Chain]:
    """The chain, cut where the number of lanes changes between two parts that are both long enough."""
    steps = chain.stations_m
    groups: list[tuple[int, int, tuple[int, int]]] = []
    for piece in chain.pieces:
        if groups and groups[-1][2] == piece.street.lanes:
            groups[-1] = (groups[-1][0], piece.last, groups[-1][2])
        else:
            groups.append((piece.first, piece.last, piece.street.lanes))
    while len(groups) > 1:
        # Too short parts first; then those that end in a bend, where lanes cannot shift.
        long = [steps[last] - steps[first] for first, last, _ in groups]
        bent = [k > 0 and _bent(chain, steps, groups[k][0]) for k in range(len(groups))]
        k = min(range(len(groups)), key=lambda k: (long[k] >= PART_M, not bent[k], long[k]))
        if long[k] >= PART_M and not bent[k]:
            break
        into = k - 1 if k else 1
        low, high = min(k, into), max(k, into)
        groups[low : high + 1] = [(groups[low][0], groups[high][1], groups[into][2])]
    for first, last, lanes in groups:
        for piece in chain.pieces:
            if first <= piece.first < last and piece.street.lanes != lanes:
                piece.street = replace(piece.street, lanes=lanes, turns=((), ()))
    cuts = [b[0] for a, b in itertools.pairwise(groups) if a[2] != b[2]]
    return _split(chain, cuts)


def _at_lights(chain: Chain, extract: Extract) -> list[Chain]:
    """The chain, cut at lit crossings far from its ends: there they are junctions of two legs."""
    steps, cuts = chain.stations_m, [0]
    for k, node in enumerate(chain.nodes):
        lit = signed_nodes(extract.node_tags.get(node, {})) == "lit crossing"
        room = min(steps[k] - steps[cuts[-1]], steps[-1] - steps[k])
        if lit and room >= BLOCK_M and not _bent(chain, steps, k):
            cuts.append(k)
    pieces = _split(chain, cuts[1:])
    for before, after in itertools.pairwise(pieces):
        before.lit, after.lit = before.lit | {after.nodes[0]}, after.lit | {after.nodes[0]}
    return pieces


def _bent(chain: Chain, steps: Array, at: int) -> bool:
    """Whether a chain turns by more than 35 degrees within 15 m of one of its nodes."""
    s = np.array([steps[at] - 15.0, steps[at], steps[at] + 15.0])
    x, y = (np.interp(s, steps, values) for values in chain.line.T)
    turn = math.atan2(y[2] - y[1], x[2] - x[1]) - math.atan2(y[1] - y[0], x[1] - x[0])
    return abs((turn + math.pi) % (2 * math.pi) - math.pi) > math.radians(35.0)


def _goes_on(node: int, around: Sequence[int], segments: Sequence[Segment]) -> bool:
    if len(around) != 2:
        return False
    (a, b), ways = around, [segments[k][2] for k in around]
    if a == b or (direction(ways[0].tags) == 0) != (direction(ways[1].tags) == 0):
        return False
    if (ways[0].tags.get("junction") == "roundabout") != (ways[1].tags.get("junction") == "roundabout"):
        return False
    # Of two one-way segments one ends here and the other begins.
    return direction(ways[0].tags) == 0 or (segments[a][1] == node) != (segments[b][1] == node)


def _walk(
    first: int,
    start: int,
    segments: Sequence[Segment],
    at: Mapping[int, Sequence[int]],
    through: set[int],
    used: set[int],
    extract: Extract,
    street_of: Callable[[Way], Street],
) -> Chain:
    nodes, k, node = [start], first, start
    pieces: list[Piece] = []
    while True:
        used.add(k)
        u, v, way = segments[k]
        node = v if u == node else u
        street = street_of(way) if u == nodes[-1] or direction(way.tags) else _reversed(street_of(way))
        nodes.append(node)
        if pieces and pieces[-1].way == way.id and pieces[-1].street == street:
            pieces[-1].last += 1
        else:
            pieces.append(Piece(street, way.id, len(nodes) - 2, len(nodes) - 1))
        onward = [n for n in at[node] if n not in used]
        if node not in through or not onward:
            return Chain(nodes, extract.line(nodes), pieces)
        k = onward[0]


def _reversed(street: Street) -> Street:
    """The street seen against the nodes of its way."""
    return replace(street, lanes=street.lanes[::-1], turns=street.turns[::-1], walks=street.walks[::-1])


def _split(chain: Chain, cuts: Sequence[int]) -> list[Chain]:
    """The chain cut at some of its nodes, by their places in it."""
    result = []
    for first, last in itertools.pairwise([0, *cuts, len(chain.nodes) - 1]):
        pieces = [
            Piece(p.street, p.way, max(p.first, first) - first, min(p.last, last) - first)
            for p in chain.pieces
            if p.first < last and p.last > first
        ]
        result.append(Chain(chain.nodes[first : last + 1], chain.line[first : last + 1], pieces))
    return result
