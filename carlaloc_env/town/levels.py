"""Roads that pass under and over each other: which of them leaves the ground, and where."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from carlaloc_env.town.fields import GroundGrid
from carlaloc_env.town.polygons import Area, areas_only, strip_polygon
from carlaloc_env.town.sections import Strip

Array = NDArray[np.float64]
Span = tuple[float, float, bool]
"""From s to s [m] on a strip, and whether the road is sunken there (or else raised)."""

APART_M = 3.0
"""Roads that cross with at least this height between them are on different levels [m]."""
LEAVES_M = 1.5
"""A road leaves the ground where it lies this far above or below its surroundings [m]."""
REACH_M = 160.0
"""Longest way from a crossing to where its road is on the ground again [m]."""
LEVEL_GRADE = 0.004
"""Grade below which a road that climbs out of an underpass has arrived."""
CLEARANCE_M = 4.5
"""Free height under a roof [m]."""
ROOF_M = 0.4
"""Thickness of the roof of an underpass [m]."""
COVER_REACH_M = 30.0
"""Farthest that an underpass stays roofed from the road that crosses it [m]."""
WALL_M = 0.3
"""Thickness of walls beside sunken and raised roads [m]."""
HIGH_M = 2.0
"""A road at least this high above the ground stands on piers instead of a bank [m]."""
_PAVED = ("roadway", "walkway", "median")
_STEP_M = 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stretch:
    """Part of a road that leaves the ground; lines run with growing s, one point per metre."""

    left_m: Array
    """Left edge of the paved part at its top [m], shape (N, 3)."""
    right_m: Array
    """Right edge [m], shape (N, 3)."""
    left_top_m: Array
    """The same with the height of the ground beside it [m], shape (N, 3)."""
    right_top_m: Array
    """The same for the right edge [m], shape (N, 3)."""
    detached: NDArray[np.bool_]
    """Where the ground goes on above (roof) or below (piers) the road, shape (N,)."""
    sunken: bool
    """Below the ground, or else above it."""

    def area(self, where: NDArray[np.bool_], wider_m: float = 0.0) -> Area:
        """Plan-view area of the runs of points that hold `where`."""
        parts = [strip_polygon(self.left_m[a:b], self.right_m[a:b]) for a, b in runs(where) if b - a > 1]
        return shapely.buffer(shapely.union_all(parts), wider_m, join_style="mitre")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Levels:
    """All stretches of a town that leave the ground."""

    stretches: tuple[Stretch, ...]
    """Sunken and raised stretches."""
    upper: Area
    """Paved areas that cross above a sunken stretch."""
    spans: dict[tuple[int, int], Span]
    """Where strips, by road and section number, leave the ground."""

    def ground_paving(self, paved: Area) -> Area:
        """What the ground leaves free: everything paved that lies on it, and open cuts with their walls."""
        result = paved
        for stretch in self.stretches:
            result = shapely.difference(result, stretch.area(stretch.detached))
            if stretch.sunken:
                result = shapely.union(result, stretch.area(grown(~stretch.detached), WALL_M))
        return areas_only(shapely.union(result, self.upper)) if self.stretches else paved

    def ground_lines(self, strip: Strip) -> list[Array]:
        """Outer edges of a strip where it lies on the ground, each (N, 3)."""
        lines = outer_lines(strip)
        span = self.spans.get((strip.road, strip.section))
        if lines is None:
            return []
        s, left, right = lines
        if span is None:
            return [left, right]
        parts = []
        for a, b in runs((s < span[0]) | (s > span[1])):
            parts += [left[a:b], right[a:b]]
        return parts


def runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Half-open ranges of rows in which a mask holds."""
    change = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(change[::2], change[1::2], strict=True)]


def grown(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The mask with one more row at both ends of each run."""
    wide = mask.copy()
    wide[1:] |= mask[:-1]
    wide[:-1] |= mask[1:]
    return wide


def outer_lines(strip: Strip) -> tuple[Array, Array, Array] | None:
    """Stations s (N,) and outer edges of the paved part at its top (N, 3), a point per metre or less."""
    span = strip.span(_PAVED)
    if span is None:
        return None
    s = np.linspace(strip.s_m[0], strip.s_m[-1], max(2, int(np.ptp(strip.s_m) / _STEP_M) + 2))
    edges = strip.lane_edges(span[0])[0], strip.lane_edges(span[1] - 1)[1]
    left, right = (np.stack([np.interp(s, strip.s_m, e[:, k]) for k in range(3)], -1) for e in edges)
    return s, left, right


def find_levels(strips: Sequence[Strip], low_m: Array, high_m: Array) -> Levels:
    """Stretches of a map, from the places where its roads cross far above each other."""
    prints = [_footprint(strip) for strip in strips]
    crossings = _crossings(strips, prints)
    spans: dict[tuple[int, int], Span] = {}
    upper = []
    for low, high, point, z_low, z_high in crossings:
        others = [s for s in strips if s.road not in (strips[low].road, strips[high].road)]
        grid = GroundGrid(_points(Levels(stretches=(), upper=None, spans={}), others), low_m, high_m)
        ground = grid.height(point[None])[0]
        if ground - z_low > LEAVES_M:
            upper.append(prints[high])
            spans.update(_walk(strips, strips[low].road, point, sunken=True))
        if z_high - ground > LEAVES_M:
            spans.update(_walk(strips, strips[high].road, point, sunken=False))
    draft = Levels(stretches=(), upper=areas_only(shapely.union_all(upper)), spans=spans)
    if not spans:
        return draft
    grid = GroundGrid(_points(draft, strips), low_m, high_m)
    places = np.array([point for _, _, point, _, _ in crossings])
    stretches = [
        _stretch(strip, spans[strip.road, strip.section], grid, places)
        for strip in strips
        if (strip.road, strip.section) in spans
    ]
    found = tuple(stretch for stretch in stretches if stretch is not None)
    return Levels(stretches=found, upper=draft.upper, spans=spans)


def _stretch(strip: Strip, span: Span, grid: GroundGrid, crossings: Array) -> Stretch | None:
    lines = outer_lines(strip)
    if lines is None:
        return None
    s, left, right = lines
    inside = (s >= span[0]) & (s <= span[1])
    if inside.sum() < 3:
        return None
    left, right = left[inside], right[inside]
    tops = []
    for edge in (left, right):
        top = edge.copy()
        ground = grid.height(edge)
        top[:, 2] = np.maximum(ground, edge[:, 2]) if span[2] else np.minimum(ground, edge[:, 2])
        # The ends of the stretch are where the road is on the ground again.
        ease = np.clip(np.minimum(s[inside] - s[inside][0], s[inside][-1] - s[inside]) / 12.0, 0.0, 1.0)
        top[:, 2] = edge[:, 2] + (top[:, 2] - edge[:, 2]) * ease
        tops.append(top)
    depth = np.abs(np.stack([tops[0][:, 2] - left[:, 2], tops[1][:, 2] - right[:, 2]]))
    middle = 0.5 * (left + right)[:, None, :2]
    near = np.hypot(*np.moveaxis(middle - crossings[None], -1, 0)).min(axis=1) < COVER_REACH_M
    roofed = (depth.min(axis=0) >= CLEARANCE_M + ROOF_M) & near
    high = depth.min(axis=0) >= HIGH_M
    return Stretch(
        left_m=left,
        right_m=right,
        left_top_m=tops[0],
        right_top_m=tops[1],
        detached=roofed if span[2] else high,
        sunken=span[2],
    )


def _walk(strips: Sequence[Strip], road: int, point: Array, *, sunken: bool) -> dict[tuple[int, int], Span]:
    """Where a road leaves the ground about a crossing: as far as it climbs out of it on both sides."""
    own = [strip for strip in strips if strip.road == road]
    s = np.concatenate([np.linspace(p.s_m[0], p.s_m[-1], int(np.ptp(p.s_m) / _STEP_M) + 2) for p in own])
    line = np.concatenate([_middle(p, int(np.ptp(p.s_m) / _STEP_M) + 2) for p in own])
    at = int(np.argmin(np.hypot(*(line[:, :2] - point).T)))
    height = line[:, 2] if sunken else -line[:, 2]
    ends = []
    for step in (-1, 1):
        row = at
        while 0 <= row + step < len(s) and abs(s[row + step] - s[at]) < REACH_M:
            gone = abs(s[row + step] - s[row])
            climbs = height[row + step] - height[row] > LEVEL_GRADE * gone
            if gone > 1e-9 and abs(s[row] - s[at]) > 15.0 and not climbs:
                break
            row += step
        ends.append(float(s[row]))
    touched = [p for p in own if p.s_m[-1] > ends[0] and p.s_m[0] < ends[1]]
    return {(p.road, p.section): (ends[0], ends[1], sunken) for p in touched}


def _middle(strip: Strip, count: int) -> Array:
    s = np.linspace(strip.s_m[0], strip.s_m[-1], count)
    centre = 0.5 * (strip.edges_m[0] + strip.edges_m[-1])
    return np.stack([np.interp(s, strip.s_m, centre[:, k]) for k in range(3)], axis=-1)


def _footprint(strip: Strip) -> Area:
    span = strip.span(_PAVED)
    if span is None:
        return shapely.Polygon()
    return strip_polygon(strip.edges_m[span[0]], strip.edges_m[span[1]])


def _crossings(strips: Sequence[Strip], prints: Sequence[Area]) -> list[tuple[int, int, Array, float, float]]:
    """Lower strip, upper strip, place (2,) and both heights [m] of all crossings on different levels."""
    tree = shapely.STRtree(np.array(prints, dtype=object))
    hits = tree.query(np.array(prints, dtype=object), predicate="intersects").T
    pairs = np.unique(np.sort(hits, axis=1), axis=0)
    found = []
    for a, b in pairs:
        if strips[a].road == strips[b].road:
            continue
        if strips[a].junction_id is not None and strips[a].junction_id == strips[b].junction_id:
            continue
        common = shapely.intersection(prints[a], prints[b])
        if common.area < 2.0:
            continue
        point = shapely.get_coordinates(shapely.centroid(common))[0]
        z = [_height_at(strips[k], point) for k in (a, b)]
        if abs(z[0] - z[1]) >= APART_M:
            low, high = (a, b) if z[0] < z[1] else (b, a)
            found.append((int(low), int(high), point, min(z), max(z)))
    return found


def _height_at(strip: Strip, point: Array) -> float:
    line = _middle(strip, int(np.ptp(strip.s_m) / _STEP_M) + 2)
    return float(line[np.argmin(np.hypot(*(line[:, :2] - point).T)), 2])


def _points(levels: Levels, strips: Sequence[Strip]) -> Array:
    lines = [line for strip in strips for line in levels.ground_lines(strip)]
    return np.concatenate(lines) if lines else np.zeros((0, 3))
