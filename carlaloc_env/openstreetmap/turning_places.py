"""Where one-way streets end at the box: short streets of our own that lead their traffic back."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import shapely

from carlaloc_env.openstreetmap.extract import Extract, Tags, Way

LOOP_M = 45.0
"""Ends that lie nearer to a beginning than this are joined by a loop [m]."""
ROOM_M = 19.0
"""Width of the narrowest loop between its parallel sides [m]."""
LEAD_M = 12.0
"""Straight before and after a loop [m]."""
RING_M = 35.0
"""Distance from all streets of the line on which farther ends are joined [m]."""
APART_M = 24.0
"""How much farther out parts of a town are joined that meet beyond the box only [m]."""
FIRST_ID = -1_000_000_000
"""Ids of nodes and ways of turning places are this and less."""
_KEPT_TAGS = ("highway", "surface")

Segment = tuple[int, int, Way]
End = tuple[float, int, str]
"""Station on the ring [m], node, and `exit`, `entry`, `home` or `apart`."""


class TurningPlaces:
    """Makes streets between one-way ends; their nodes are added to the extract."""

    def __init__(self, segments: Sequence[Segment], extract: Extract) -> None:
        self._segments = segments
        self._extract = extract
        self._fresh = FIRST_ID
        places = [(extract.xy_m[u], extract.xy_m[v]) for u, v, _ in segments]
        self._tree = shapely.STRtree(shapely.linestrings(places))
        self._leads: dict[int, list[tuple[float, float]]] = {}
        self.ways: list[Way] = []

    def join(
        self, exits: Sequence[int], entries: Sequence[int], homes: Sequence[int], apart: Sequence[int]
    ) -> list[Way]:
        """Streets that lead everything back.

        Args:
            exits: Nodes at which one-way streets end.
            entries: Nodes at which they begin.
            homes: Ends of two-way streets of the largest part.
            apart: The same of parts that are joined to it beyond the box only.
        """
        near = self._near_pairs(exits, entries)
        for leaving, joining in near:
            self._loop(leaving, joining)
        done = {node for pair in near for node in pair}
        rest = {
            "exit": [node for node in exits if node not in done],
            "entry": [node for node in entries if node not in done],
        }
        if all(rest.values()):
            self._arcs(rest, RING_M)
        if apart and homes:
            self._arcs({"home": homes, "apart": apart}, RING_M + APART_M)
        return self.ways

    def _near_pairs(self, exits: Sequence[int], entries: Sequence[int]) -> list[tuple[int, int]]:
        xy, found, taken = self._extract.xy_m, [], set()
        pairs = sorted((math.dist(xy[a], xy[b]), a, b) for a in exits for b in entries)
        for far, a, b in pairs:
            if far > LOOP_M:
                break
            if a in taken or b in taken or a == b:
                continue
            ahead, back = self._heading(a), self._heading(b)
            if ahead[0] * back[0] + ahead[1] * back[1] < -0.5 and not self._crossed([xy[a], xy[b]], {a, b}):
                found.append((a, b))
                taken |= {a, b}
        return found

    def _heading(self, node: int) -> tuple[float, float]:
        """Direction of traffic at an end."""
        xy = self._extract.xy_m
        u, v, way = next(s for s in self._segments if node in s[:2])
        if way.tags.get("oneway", "no") == "no" and node == u:
            u, v = v, u  # Out of a two-way street.
        dx, dy = xy[v][0] - xy[u][0], xy[v][1] - xy[u][1]
        length = math.hypot(dx, dy) or 1.0
        return dx / length, dy / length

    def _tags(self, node: int) -> Tags:
        way = next(s[2] for s in self._segments if node in s[:2])
        kept = {key: way.tags[key] for key in _KEPT_TAGS if key in way.tags}
        return {
            **kept,
            "lanes": "1",
            "oneway": "yes",
            "maxspeed": "30",
            "sidewalk": "no",
            "name": "Turning place",
        }

    def _loop(self, leaving: int, joining: int) -> None:
        """Straight on, round and back: sideways first where both lie close together."""
        xy = self._extract.xy_m
        (x, y), (c, s) = xy[leaving], self._heading(leaving)
        dx, dy = xy[joining][0] - x, xy[joining][1] - y
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

    def _arcs(self, kinds: Mapping[str, Sequence[int]], out_m: float) -> None:
        """Two-way streets round the town between neighbouring ends, as few as lead everything back."""
        xy = self._extract.xy_m
        corners = [xy[node] for s in self._segments for node in s[:2]]
        ring = shapely.buffer(shapely.MultiPoint(corners).convex_hull, out_m).exterior
        ends = []
        for node, kind in sorted((node, kind) for kind, nodes in kinds.items() for node in nodes):
            place = shapely.Point(xy[node])
            if kind in ("home", "apart") and shapely.distance(ring, place) > 2.0 * out_m:
                continue
            at = shapely.line_locate_point(ring, place)
            foot = shapely.get_coordinates(shapely.line_interpolate_point(ring, at))[0]
            end = (float(foot[0]), float(foot[1]))
            way = self._way_out(node, end, leaves=kind != "entry")
            if way is not None:
                self._leads[node] = way
                ends.append((float(at), node, kind))
        ends.sort()
        for group in _groups(ends, ring.length):
            self._street(ring, group)

    def _way_out(
        self, node: int, foot: tuple[float, float], *, leaves: bool
    ) -> list[tuple[float, float]] | None:
        """Points between a one-way end and its place on the ring; None where streets lie between."""
        (x, y), (c, s) = self._extract.xy_m[node], self._heading(node)
        sign = 1.0 if leaves else -1.0
        dx, dy = foot[0] - x, foot[1] - y
        if sign * (c * dx + s * dy) > -0.3 * math.hypot(dx, dy):
            return None if self._crossed([(x, y), foot], {node}) else []
        # The ring lies behind: straight on first, then round.
        side = math.copysign(1.0, -s * dx + c * dy)
        for turn in (side, -side):
            ahead = (x + sign * LEAD_M * c, y + sign * LEAD_M * s)
            aside = (ahead[0] - turn * ROOM_M * s, ahead[1] + turn * ROOM_M * c)
            if not self._crossed([(x, y), ahead, aside, foot], {node}):
                return [ahead, aside]
        return None

    def _street(self, ring: shapely.LinearRing, group: Sequence[End]) -> None:
        nodes: list[int] = []
        tags = {**self._tags(group[0][1]), "lanes": "2", "oneway": "no", "highway": "tertiary"}
        before = 0.0
        for k, (at, node, kind) in enumerate(group):
            steps = np.linspace(before, at, int(abs(at - before) / 15.0) + 2)[1:-1] if k else np.zeros(0)
            inner = shapely.line_interpolate_point(ring, steps % ring.length)
            nodes += self._nodes([tuple(p) for p in shapely.get_coordinates(inner)])
            foot = shapely.get_coordinates(shapely.line_interpolate_point(ring, at % ring.length))[0]
            (own,) = self._nodes([(float(foot[0]), float(foot[1]))])
            nodes.append(own)
            lead = [node, *self._nodes(self._leads[node]), own]
            both = {"lanes": "2", "oneway": "no"} if kind in ("home", "apart") else {}
            self._add(lead if kind != "entry" else lead[::-1], {**self._tags(node), **both})
            before = at
        self._add(nodes, tags)

    def _nodes(self, points: Sequence[tuple[float, float]]) -> list[int]:
        found = []
        for x, y in points:
            self._fresh -= 1
            self._extract.xy_m[self._fresh] = (round(float(x), 4), round(float(y), 4))
            found.append(self._fresh)
        return found

    def _add(self, nodes: Sequence[int], tags: Tags) -> None:
        self._fresh -= 1
        self.ways.append(Way(self._fresh, tuple(nodes), tags))

    def _crossed(self, points: Sequence[tuple[float, float]], own: set[int]) -> bool:
        """Whether a line meets a street that does not end at one of the nodes."""
        line = shapely.LineString(points)
        made = [shapely.LineString([self._extract.xy_m[n] for n in way.nodes]) for way in self.ways]
        hit = self._tree.query(line, predicate="intersects")
        return any(line.crosses(way) for way in made) or any(
            not own & set(self._segments[k][:2]) for k in hit
        )


def _groups(ends: Sequence[End], whole: float) -> list[list[End]]:
    """Neighbours on a ring in groups from which all can return, joined over the shortest gaps first."""
    count = len(ends)
    group = list(range(count))

    def served(k: int) -> bool:
        kinds = {ends[i][2] for i in range(count) if group[i] == k}
        return "home" in kinds or {"exit", "entry"} <= kinds

    gaps = sorted(((ends[(i + 1) % count][0] - ends[i][0]) % whole, i) for i in range(count))
    cut = {i for _, i in gaps}
    for _, i in gaps:
        a, b = group[i], group[(i + 1) % count]
        if a != b and not (served(a) and served(b)):
            group = [a if k == b else k for k in group]
            cut.discard(i)
    if not cut and gaps:
        cut = {gaps[-1][1]}
    result = []
    for i in sorted(cut):
        members: list[End] = []
        k, turn = (i + 1) % count, 0.0
        while True:
            if members and ends[k][0] + turn < members[-1][0]:
                turn += whole
            members.append((ends[k][0] + turn, *ends[k][1:]))
            if k in cut:
                break
            k = (k + 1) % count
        if len(members) > 1:
            result.append(members)
    return result


def one_way_ends(edges: Sequence[tuple[int, int]]) -> tuple[list[int], list[int]]:
    """Nodes from which no street leads on, and nodes to which none leads."""
    sources, targets = {a for a, _ in edges}, {b for _, b in edges}
    return sorted(targets - sources), sorted(sources - targets)
