"""Where streets end at the box: streets of our own that lead traffic back, and to parts that are cut off."""

from __future__ import annotations

import itertools
import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from carlaloc_env.openstreetmap.elements import Tags, Way
from carlaloc_env.openstreetmap.extract import Extract
from carlaloc_env.openstreetmap.tags import direction

LOOP_M = 45.0
"""Ends that lie nearer to a beginning than this are joined by a loop [m]."""
ROOM_M = 19.0
"""Width of the narrowest loop between its parallel sides [m]."""
LEAD_M = 12.0
"""Straight before and after a loop [m]."""
BULB_M = 24.0
"""Length of the ends of two-way streets [m]."""
RING_M = 35.0
"""Distance from all streets of the line on which other ends are joined [m]."""
BOTH_WAYS_M = 105.0
"""Two-way streets that end farther from that line are dead ends, not cut [m]."""
APART_M = 33.0
"""Least distance of the places where ends meet that line [m]."""
SHIFTS_M = (0.0, 12.0, -12.0, 24.0, -24.0, 40.0, -40.0, 65.0, -65.0, 100.0, -100.0, 150.0, -150.0)
"""How far from its nearest place on the line an end is led [m]."""
STRAIGHTS_M = (21.6, 18.0, 15.6)
"""Straight before that line, the first with which an end can be led there [m]."""
SHARPEST = 0.1
"""Cosine of the sharpest corner of a turning place."""
FIRST_ID = -1_000_000_000
"""Ids of nodes and ways of turning places are this and less."""
PLACE_NAME = "Turning place"
"""Name of their streets."""
_KEPT_TAGS = ("highway", "surface")

Node = TypeVar("Node", int, tuple[int, bool])
Segment = tuple[int, int, Way]
Point = tuple[float, float]


@dataclass(slots=True)
class _Lead:
    """A street from an end to the ring."""

    at: float
    """Station on the ring [m]."""
    node: int
    kind: str
    """`exit`, `entry` or `both`."""
    points: list[Point]
    """Its corners between the end and the ring."""
    length: float
    needed: bool = True
    arc: bool = True
    """Whether the ring is built from here to the next end."""


def directed(segments: Iterable[Segment]) -> list[tuple[int, int]]:
    """Pairs of nodes between which one may drive."""
    edges = [(u, v, direction(way.tags)) for u, v, way in segments]
    return [(u, v) for u, v, _ in edges] + [(v, u) for u, v, oneway in edges if oneway == 0]


def parts(edges: Sequence[tuple[Node, Node]], connection: Literal["weak", "strong"]) -> dict[Node, int]:
    """Number of the part to which each node belongs; connection is `weak` or `strong`."""
    number = {node: k for k, node in enumerate(sorted({node for edge in edges for node in edge}))}
    rows, columns = np.array([[number[a], number[b]] for a, b in edges]).T
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(len(number),) * 2)
    labels: NDArray[np.int32] = connected_components(graph, connection=connection)[1]
    return {node: int(labels[k]) for node, k in number.items()}


def lengths(
    segments: Iterable[Segment], part: Mapping[int, int], xy_m: Mapping[int, Point]
) -> dict[int, float]:
    """Length of the streets inside each part [m]."""
    length_m: dict[int, float] = defaultdict(float)
    for u, v, _ in segments:
        if part[u] == part[v]:
            length_m[part[u]] += math.dist(xy_m[u], xy_m[v])
    return length_m


def longest(segments: Iterable[Segment], part: Mapping[int, int], xy_m: Mapping[int, Point]) -> int:
    """Number of the part with the longest streets; -1 where no part has any."""
    length_m = lengths(segments, part, xy_m)
    return max(length_m, key=lambda k: (length_m[k], -k), default=-1)


class TurningPlaces:
    """Makes streets between ends; their nodes are added to the extract."""

    def __init__(self, segments: Sequence[Segment], extract: Extract) -> None:
        self._segments = segments
        self._xy = extract.xy_m
        self._fresh = FIRST_ID
        self._at: dict[int, list[Segment]] = defaultdict(list)
        for segment in segments:
            for node in segment[:2]:
                self._at[node].append(segment)
        self._tree = shapely.STRtree(
            shapely.linestrings([(self._xy[u], self._xy[v]) for u, v, _ in segments])
        )
        self._taken: list[shapely.LineString] = []
        """Turning places so far."""
        self.ways: list[Way] = []

    def join(self) -> list[Way]:
        """Streets that lead all traffic back, as few as lead to every part."""
        edges = directed(self._segments)
        sources, targets = {a for a, _ in edges}, {b for _, b in edges}
        exits, entries = sorted(targets - sources), sorted(sources - targets)
        joined = self._loops(exits, entries)
        corners = [self._xy[node] for node in self._at] + [
            self._xy[node] for way in self.ways for node in way.nodes
        ]
        ring = shapely.buffer(shapely.MultiPoint(corners).convex_hull, RING_M).exterior
        kinds = dict.fromkeys(exits, "exit") | dict.fromkeys(entries, "entry")
        for node, around in self._at.items():
            if len(around) == 1 and node not in kinds:
                kinds[node] = "both"
                (x, y), (c, s) = self._xy[node], self._outward(node)
                self._taken.append(shapely.LineString([(x, y), (x + BULB_M * c, y + BULB_M * s)]))
        far = {node: float(shapely.distance(ring, shapely.Point(self._xy[node]))) for node in kinds}
        ends = [n for n in kinds.keys() - joined if kinds[n] != "both" or far[n] <= BOTH_WAYS_M]
        at = {n: float(shapely.line_locate_point(ring, shapely.Point(self._xy[n]))) for n in ends}
        ends.sort(key=lambda node: (at[node], node))
        at = dict(zip(ends, _spread([at[node] for node in ends], ring.length), strict=True))
        leads: list[_Lead] = []
        for node in sorted(ends, key=lambda node: (far[node], node)):
            leads += self._lead(ring, node, kinds[node], at[node], [lead.at for lead in leads])
        leads.sort(key=lambda lead: lead.at)
        self._fewest(leads, ring.length)
        self._build(ring, leads)
        return self.ways

    def _outward(self, node: int) -> Point:
        """Direction of an end, away from its street."""
        before, at, far = node, node, 0.0
        while far < LEAD_M and (at == node or len(self._at[at]) == 2):
            onward = [n for segment in self._at[at] for n in segment[:2] if n not in (at, before)]
            if not onward:
                break
            far += math.dist(self._xy[at], self._xy[onward[0]])
            before, at = at, onward[0]
        (x, y), (p, q) = self._xy[node], self._xy[at]
        length = math.hypot(x - p, y - q) or 1.0
        return (x - p) / length, (y - q) / length

    def _loops(self, exits: Sequence[int], entries: Sequence[int]) -> set[int]:
        """Join the ends of the two carriageways of one street; the ends that are done."""
        done: set[int] = set()
        part = parts(directed(self._segments), "weak")
        largest = longest(self._segments, part, self._xy)
        ends = Counter((part[node], k) for k, nodes in enumerate((exits, entries)) for node in nodes)
        pairs = sorted((math.dist(self._xy[a], self._xy[b]), a, b) for a in exits for b in entries)
        for far, a, b in pairs:
            one, other = part[a], part[b]
            left = [sum(ends[k, kind] for k in {one, other}) for kind in (0, 1)]
            # Parts that meet the rest beyond the box only keep an end of each kind for this.
            if far > LOOP_M or {a, b} & done or (not one == other == largest and min(left) < 2):
                continue
            (c, s), (u, v) = self._outward(a), self._outward(b)
            if c * u + s * v > 0.5 and not self._crossed([self._xy[a], self._xy[b]], {a, b}):
                self._loop(a, b, c, s)
                done |= {a, b}
                part = {node: one if k == other else k for node, k in part.items()}
                largest = one if largest == other else largest
                ends[one, 0], ends[one, 1] = left[0] - 1, left[1] - 1
        return done

    def _tags(self, node: int) -> Tags:
        way = self._at[node][0][2]
        kept = {key: way.tags[key] for key in _KEPT_TAGS if key in way.tags}
        own = {"lanes": "1", "oneway": "yes", "maxspeed": "30", "sidewalk": "no", "name": PLACE_NAME}
        return kept | own

    def _loop(self, leaving: int, joining: int, c: float, s: float) -> None:
        """Straight on, round and back: sideways first where both lie close together."""
        x, y = self._xy[leaving]
        dx, dy = self._xy[joining][0] - x, self._xy[joining][1] - y
        u, v = c * dx + s * dy, -s * dx + c * dy
        aside = max(0.0, (ROOM_M - abs(v)) / 2)
        sign = 1.0 if v >= 0 else -1.0
        near, far = max(0.0, u) + LEAD_M, max(0.0, u) + LEAD_M + (1.4 * aside + 4.0 if aside else 0.0)
        end = far + ROOM_M
        local = [(near, 0.0), (far, -sign * aside), (end, -sign * aside)]
        local += [(end, v + sign * aside), (far, v + sign * aside), (near, v)]
        if not aside:
            local = [(near + ROOM_M / 2, 0.0), (near + ROOM_M / 2, v)]
        points = [(x + c * p - s * q, y + s * p + c * q) for p, q in local]
        self._add([leaving, *self._nodes(points), joining], self._tags(leaving))

    def _lead(
        self, ring: shapely.LinearRing, node: int, kind: str, wanted: float, taken: Sequence[float]
    ) -> list[_Lead]:
        """The first of several lines from an end to the ring that meets no street; none if all do."""
        (x, y), (c, s) = self._xy[node], self._outward(node)
        ahead = (x + LEAD_M * c, y + LEAD_M * s)
        asides = [(ahead[0] - side * ROOM_M * s, ahead[1] + side * ROOM_M * c) for side in (1.0, -1.0)]
        for shift, straight in itertools.product(SHIFTS_M, STRAIGHTS_M):
            at = (wanted + shift) % ring.length
            if any(
                min((at - other) % ring.length, (other - at) % ring.length) < APART_M - 1.0 for other in taken
            ):
                continue
            ((p, q),) = shapely.get_coordinates(shapely.line_interpolate_point(ring, at)).tolist()
            before = _before(ring, at, straight)
            for first in ([], [ahead], *([ahead, aside] for aside in asides)):
                via = [*first, before]
                line = [(x, y), *via, (p, q)]
                if not _sharp([(x - c, y - s), *line]) and not self._crossed(line, {node}):
                    self._taken.append(shapely.LineString(line))
                    return [_Lead(at, node, kind, via, self._taken[-1].length)]
        return []

    def _fewest(self, leads: Sequence[_Lead], whole: float) -> None:
        """Leave out stretches of the ring, and leads, while every part can be reached: the longest first."""
        made = [pair for way in self.ways for pair in zip(way.nodes, way.nodes[1:], strict=False)]
        edges = [*directed(self._segments), *made]
        part = parts(edges, "strong")
        across = sorted({(part[a], part[b]) for a, b in edges if part[a] != part[b]})

        def reached() -> Mapping[int, int]:
            links = list(across) + [(k, k) for k in set(part.values())]
            for k, lead in enumerate(leads):
                foot, end = -1 - k, part[lead.node]
                if lead.needed:
                    links += [(end, foot)] * (lead.kind != "entry") + [(foot, end)] * (lead.kind != "exit")
                if lead.arc:
                    onward = -1 - (k + 1) % len(leads)
                    links += [(foot, onward), (onward, foot)]
            return parts(links, "strong")

        home = reached()
        largest = longest(self._segments, {node: home[k] for node, k in part.items()}, self._xy)
        wanted = [k for k in set(part.values()) if home[k] == largest]

        def spare(lead: _Lead, name: str) -> None:
            setattr(lead, name, False)
            now = reached()
            if len({now[k] for k in wanted}) > 1:
                setattr(lead, name, True)

        gaps = {id(a): (b.at - a.at) % whole for a, b in zip(leads, [*leads[1:], *leads[:1]], strict=True)}
        for name in ("arc", "needed", "arc"):
            for lead in sorted(leads, key=lambda k: -(gaps[id(k)] if name == "arc" else k.length)):
                if name == "arc" or lead.kind == "both" or home[part[lead.node]] != largest:
                    spare(lead, name)

    def _build(self, ring: shapely.LinearRing, leads: Sequence[_Lead]) -> None:
        """Two-way streets round the town, and the leads that meet them."""
        count = len(leads)
        for first in range(count):
            if not leads[first].arc or leads[first - 1].arc:
                continue
            nodes: list[int] = []
            k, before = first, leads[first].at
            while True:
                lead = leads[k % count]
                at = before + (lead.at - before) % ring.length
                steps = (
                    np.linspace(before, at, int((at - before) / 15.0) + 2)[1:-1] if k > first else np.zeros(0)
                )
                inner = shapely.line_interpolate_point(ring, np.append(steps, at) % ring.length)
                nodes += self._nodes(shapely.get_coordinates(inner).tolist())
                if lead.needed:
                    line = [lead.node, *self._nodes(lead.points), nodes[-1]]
                    both = {"lanes": "2", "oneway": "no"} if lead.kind == "both" else {}
                    self._add(line[::-1] if lead.kind == "entry" else line, {**self._tags(lead.node), **both})
                before = at
                if not lead.arc:
                    break
                k += 1
            tags = {"lanes": "2", "oneway": "no", "highway": "tertiary"}
            self._add(nodes, {**self._tags(leads[first].node), **tags})

    def _nodes(self, points: Iterable[Sequence[float]]) -> list[int]:
        nodes = []
        for x, y in points:
            self._fresh -= 1
            self._xy[self._fresh] = (round(float(x), 4), round(float(y), 4))
            nodes.append(self._fresh)
        return nodes

    def _add(self, nodes: Sequence[int], tags: Tags) -> None:
        self._fresh -= 1
        self.ways.append(Way(self._fresh, tuple(nodes), tags))
        self._taken.append(shapely.LineString([self._xy[n] for n in nodes]))

    def _crossed(self, points: Sequence[Point], own: set[int]) -> bool:
        """Whether a line meets a turning place, or a street that does not end at one of the nodes."""
        line = shapely.LineString(points)
        hit = self._tree.query(line, predicate="intersects")
        return any(line.crosses(way) for way in self._taken) or any(
            not own & set(self._segments[k][:2]) for k in hit
        )


def _before(ring: shapely.LinearRing, at: float, straight_m: float) -> Point:
    """A point inside a ring, from which a street meets it at a right angle."""
    places = shapely.line_interpolate_point(ring, np.array([at - 1.0, at, at + 1.0]) % ring.length)
    (x0, y0), (x, y), (x1, y1) = shapely.get_coordinates(places).tolist()
    side = straight_m / math.hypot(x1 - x0, y1 - y0) * (1.0 if ring.is_ccw else -1.0)
    return x - side * (y1 - y0), y + side * (x1 - x0)


def _spread(stations: Sequence[float], whole: float) -> list[float]:
    """Stations on a ring, moved as little as goes so that neighbours are apart; in order."""
    if not stations:
        return []
    gaps = np.diff(stations, append=stations[0] + whole)
    first = (int(np.argmax(gaps)) + 1) % len(stations)
    x = (np.roll(stations, -first) - stations[first]) % whole - APART_M * np.arange(len(stations))
    blocks: list[tuple[float, int]] = []
    for value in x.tolist():
        blocks.append((value, 1))
        while len(blocks) > 1 and blocks[-2][0] > blocks[-1][0]:
            (b, n), (a, m) = blocks.pop(), blocks.pop()
            blocks.append(((a * m + b * n) / (m + n), m + n))
    level = np.repeat([value for value, _ in blocks], [count for _, count in blocks])
    moved = level + APART_M * np.arange(len(stations)) + stations[first]
    return [round(float(value), 4) % whole for value in np.roll(moved, first)]


def _sharp(points: Sequence[Point]) -> bool:
    """Whether a line has a corner that is too sharp for a street."""
    steps = np.diff(np.array(points), axis=0)
    steps /= np.maximum(np.hypot(*steps.T), 1e-9)[:, None]
    return bool(((steps[1:] * steps[:-1]).sum(axis=1) < SHARPEST).any())
