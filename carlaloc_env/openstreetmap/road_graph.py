"""The streets of an extract as chains between junctions: those on which one can drive for ever."""

from __future__ import annotations

import itertools
import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import MapError
from carlaloc_env.openstreetmap.extract import Extract, Way
from carlaloc_env.openstreetmap.tags import Street, direction, for_cars
from carlaloc_env.openstreetmap.turning_places import FIRST_ID, TurningPlaces, one_way_ends

PART_LEAST_M = 80.0
"""Parts of the streets that are shorter and apart from the rest are left out [m]."""
PART_M = 30.0
"""Parts of a street with other numbers of lanes that are shorter are built like their neighbours [m]."""


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

    @property
    def oneway(self) -> bool:
        """Whether no traffic runs against the nodes."""
        return self.pieces[0].street.oneway

    @property
    def length_m(self) -> float:
        """Length of the line [m]."""
        return float(np.hypot(*np.diff(self.line, axis=0).T).sum())

    @property
    def street(self) -> Street:
        """The street of its longest part."""
        steps = np.hypot(*np.diff(self.line, axis=0).T)
        return max(self.pieces, key=lambda p: float(steps[p.first : p.last].sum())).street


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
    """Length of all streets for cars that lead anywhere [m]."""


Segment = tuple[int, int, Way]


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
    segments = _opened(segments, extract)
    largest = _strong(segments, extract, _outside(segments))
    everywhere, apart = _with_parts(segments, largest, extract)
    homes = _dead_ends(largest)
    places = TurningPlaces(everywhere, extract)
    more = [(u, v, way) for way in places.join(*one_way_ends(_directed(everywhere)), homes, apart)
            for u, v in itertools.pairwise(way.nodes)]  # fmt: skip
    kept = _strong([*everywhere, *more], extract, ())
    own = [s for s in kept if s[2].id > FIRST_ID]
    if _length(own, extract) < 60.0:
        raise MapError(
            f"{extract.source} has no streets here on which one could drive for ever; give a larger box"
        )
    graph = RoadGraph(
        chains=_chains(kept, extract, street_of),
        asked_m=_length(everywhere, extract),
        kept_m=_length(own, extract),
        turning_m=_length(kept, extract) - _length(own, extract),
    )
    built, reachable = {way.id for _, _, way in kept}, {way.id for _, _, way in everywhere}
    for _, _, way in segments:
        if way.id not in built:
            why = "its one-way end leads nowhere" if way.id in reachable else "it joins no other street here"
            graph.left_out[way.id] = why
    return graph


def _with_parts(
    segments: Sequence[Segment], largest: Sequence[Segment], extract: Extract
) -> tuple[list[Segment], list[int]]:
    """The largest part and others that end at the box like it; and two-way ends of these."""
    found, taken = list(largest), {(u, v, way.id) for u, v, way in largest}
    apart: list[int] = []
    rest = [(u, v, way) for u, v, way in segments if (u, v, way.id) not in taken]
    while rest:
        part = _strong(rest, extract, _outside(rest))
        if _length(part, extract) < PART_LEAST_M:
            break
        ends = _dead_ends(part)
        taken = {(u, v, way.id) for u, v, way in part}
        rest = [(u, v, way) for u, v, way in rest if (u, v, way.id) not in taken]
        if ends:
            found += part
            apart += ends
    return found, apart


def _dead_ends(segments: Sequence[Segment]) -> list[int]:
    """Nodes at which two-way streets end."""
    degree = Counter(node for s in segments for node in s[:2])
    return sorted({n for s in segments if direction(s[2].tags) == 0 for n in s[:2] if degree[n] == 1})


def _opened(segments: Sequence[Segment], extract: Extract) -> list[Segment]:
    """One-way streets that end where their own way back begins, without turning anywhere else, apart."""
    into: dict[int, list[int]] = defaultdict(list)
    out_of: dict[int, list[int]] = defaultdict(list)
    for k, (u, v, way) in enumerate(segments):
        for a, b in ((u, v), (v, u))[: 1 if direction(way.tags) else 2]:
            into[b].append(k)
            out_of[a].append(k)
    result = list(segments)
    for node, arriving in into.items():
        leaving = out_of.get(node, [])
        if len(arriving) != 1 or len(leaving) != 1 or arriving == leaving:
            continue
        (u, _, _), (_, v, way) = segments[arriving[0]], segments[leaving[0]]
        before, at, after = (np.array(extract.xy_m[k]) for k in (u, node, v))
        step, onward = at - before, after - at
        if float(step[0] * onward[0] + step[1] * onward[1]) < -0.85 * np.hypot(*step) * np.hypot(*onward):
            fresh = FIRST_ID - 500_000 - len(extract.xy_m)
            extract.xy_m[fresh] = extract.xy_m[node]
            result[leaving[0]] = (fresh, v, way)
    return result


def _length(segments: Iterable[Segment], extract: Extract) -> float:
    return math.fsum(math.dist(extract.xy_m[u], extract.xy_m[v]) for u, v, _ in segments)


def _directed(segments: Sequence[Segment]) -> list[tuple[int, int]]:
    edges = [(u, v) for u, v, _ in segments]
    return edges + [(v, u) for u, v, way in segments if direction(way.tags) == 0]


def _outside(segments: Sequence[Segment]) -> list[tuple[int, int]]:
    """Edges through one node that stands for everything beyond the extract."""
    exits, entries = one_way_ends(_directed(segments))
    return [(node, 0) for node in exits] + [(0, node) for node in entries]


def _strong(segments: Sequence[Segment], extract: Extract, more: Sequence[tuple[int, int]]) -> list[Segment]:
    """Segments of the longest part in which every place can be reached from every other."""
    edges = [*_directed(segments), *more]
    number = {node: k for k, node in enumerate(sorted({node for edge in edges for node in edge}))}
    rows, columns = np.array([[number[a], number[b]] for a, b in edges]).T
    shape = (len(number),) * 2
    _, part = connected_components(
        coo_matrix((np.ones(len(edges)), (rows, columns)), shape=shape), connection="strong"
    )
    length: Counter[int] = Counter()
    for u, v, _ in segments:
        if part[number[u]] == part[number[v]]:
            length[int(part[number[u]])] += math.dist(extract.xy_m[u], extract.xy_m[v])  # type: ignore[assignment]
    best = max(length, key=lambda k: (length[k], -k), default=-1)
    return [s for s in segments if part[number[s[0]]] == best == part[number[s[1]]]]


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
    cut = [part for chain in chains for part in _by_lanes(chain)]
    # A ring that begins and ends at one junction is cut in its middle.
    rings = [chain.nodes[0] == chain.nodes[-1] and len(chain.nodes) > 3 for chain in cut]
    return [part for chain, ring in zip(cut, rings, strict=True)
            for part in (_split(chain, [len(chain.nodes) // 2]) if ring else [chain])]  # fmt: skip


def _by_lanes(chain: Chain) -> list[Chain]:
    """The chain, cut where the number of lanes changes between two parts that are both long enough."""
    steps = np.append(0.0, np.cumsum(np.hypot(*np.diff(chain.line, axis=0).T)))
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
