"""All lanes of a map in one row of numbers, and their edges as t over s."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.map.opendrive.cubic_table import CubicTable
from carlaloc_env.map.opendrive.records import Cubic, LaneRecord, LaneSection, Road

ROUNDING_M = 1e-6
"""Widths that fall below 0 by less are rounded, not wrong [m]."""


class Edge(NamedTuple):
    """A line across road coordinates, each field (M,)."""

    t_m: Array
    slope: Array
    """Derivative of t by s."""
    bend: Array
    """Second derivative of t by s [1/m]."""


class LaneEdges:
    """Every lane but the centre ones, numbered road by road, section by section, from left to right."""

    def __init__(self, roads: Sequence[Road]) -> None:
        """Numbers the lanes and gathers their width and border records."""
        self.lanes: list[LaneRecord] = []
        self.sections: list[LaneSection] = []
        self.index: dict[tuple[int, int, int], int] = {}
        """(road number, section number, lane id) → lane number."""
        road_of, section_of, inner = [], [], []
        for r, road in enumerate(roads):
            for k, section in enumerate(road.sections):
                base = len(self.lanes)
                own = [lane for lane in section.lanes if lane.id != 0]
                # From left to right: the inner lane of a left lane follows it, of a right lane precedes it.
                left = sum(1 for lane in own if lane.id > 0)
                for n, lane in enumerate(own):
                    self.index[r, k, lane.id] = base + n
                    self.lanes.append(lane)
                    self.sections.append(section)
                    road_of.append(r)
                    section_of.append(k)
                    neighbour = n + 1 if n < left else n - 1
                    inner.append(-1 if neighbour == left and n < left else base + neighbour)
                    if n == left:
                        inner[-1] = -1
        self.road: Index = np.array(road_of, dtype=np.int64)
        self.section: Index = np.array(section_of, dtype=np.int64)
        self._inner: Index = np.array(inner, dtype=np.int64)
        self.side: Array = np.array([1.0 if lane.id > 0 else -1.0 for lane in self.lanes])
        self._has_border: NDArray[np.bool_] = np.array(
            [bool(lane.borders) and not lane.widths for lane in self.lanes], dtype=bool
        )
        self._any_border = bool(self._has_border.any())
        self._width = CubicTable([lane.widths for lane in self.lanes])
        self._border = CubicTable([lane.borders for lane in self.lanes])
        self._offset = CubicTable([road.lane_offset for road in roads])
        heights = [lane.heights for lane in self.lanes]
        self._height_inner = CubicTable([_ramps([(r.s_m, r.inner_m) for r in own]) for own in heights])
        self._height_outer = CubicTable([_ramps([(r.s_m, r.outer_m) for r in own]) for own in heights])

    def lane_offset(self, road: Index, s_m: Array) -> Edge:
        """The line that lane 0 stands for."""
        return Edge(*self._offset.evaluate(road, s_m))

    def outer(self, lane: Index, s_m: Array) -> Edge:
        """Outer edges of lanes."""
        return self._walk(lane, s_m)

    def inner(self, lane: Index, s_m: Array) -> Edge:
        """Inner edges of lanes."""
        return self._walk(self._inner[lane], s_m, start=lane)

    def width(self, lane: Index, s_m: Array) -> Array:
        """Widths [m]; 0 where they are negative in the file."""
        if not self._any_border:
            return self._widths(lane, s_m)[0]
        return (self.outer(lane, s_m).t_m - self.inner(lane, s_m).t_m) * self.side[lane]

    def stated_width(self, lane: Index, s_m: Array) -> Array:
        """Widths as the file has them [m]: negative where its polynomials are."""
        border = self._offset.evaluate(self.road[lane], s_m)[0] + self._border.evaluate(lane, s_m)[0]
        between = (border - self.inner(lane, s_m).t_m) * self.side[lane]
        return np.where(self._has_border[lane], between, self._width.evaluate(lane, s_m)[0])

    def centre(self, lane: Index, s_m: Array) -> Edge:
        """Centre lines of lanes."""
        inner = self.inner(lane, s_m)
        if self._any_border:
            outer = self.outer(lane, s_m)
            return Edge(*(0.5 * (a + b) for a, b in zip(inner, outer, strict=True)))
        half = 0.5 * self.side[lane]
        return Edge(*(a + half * w for a, w in zip(inner, self._widths(lane, s_m), strict=True)))

    def heights(self, lane: Index, s_m: Array) -> tuple[Array, Array, Array, Array]:
        """Height above the road surface at inner and outer edge [m], then their slopes by s."""
        inner, inner_slope, _ = self._height_inner.evaluate(lane, s_m)
        outer, outer_slope, _ = self._height_outer.evaluate(lane, s_m)
        return inner, outer, inner_slope, outer_slope

    def _widths(self, lane: Index, s_m: Array) -> Sequence[Array]:
        """Widths by their own records, with two derivatives; 0 where the file's polynomial is negative."""
        parts = self._width.evaluate(lane, s_m)
        negative = parts[0] < -ROUNDING_M
        return [np.where(negative, 0.0, part) for part in parts] if negative.any() else parts

    def _walk(self, lane: Index, s_m: Array, *, start: Index | None = None) -> Edge:
        lanes = lane if start is None else start
        total = [part.copy() for part in self._offset.evaluate(self.road[lanes], s_m)]
        side = self.side[lanes]
        # Of all borders inside of a lane, the outermost counts: no lane reaches into the one inside of it.
        farthest = [np.full(len(side), np.nan) for _ in total]
        current = lane.copy()
        while True:
            active = np.flatnonzero(current >= 0)
            if not len(active):
                break
            at, s = current[active], s_m[active]
            for part, width in zip(total, self._widths(at, s), strict=True):
                part[active] += side[active] * width
            if self._any_border:
                own = self._has_border[at]
                borders = self._border.evaluate(at[own], s[own])
                bounds = [part[active[own]] + b for part, b in zip(total, borders, strict=True)]
                _take_farther(farthest, active[own], bounds, side)
            current[active] = self._inner[at]
        if self._any_border:
            bounded = np.flatnonzero(np.isfinite(farthest[0]))
            _take_farther(farthest, bounded, [part[bounded] for part in total], side)
            total = [np.where(np.isfinite(farthest[0]), a, b) for a, b in zip(farthest, total, strict=True)]
        return Edge(*total)


def _take_farther(farthest: list[Array], rows: Index, edges: Sequence[Array], side: Array) -> None:
    """Takes over those edges that lie farther out than the outermost so far."""
    outermost = farthest[0][rows]
    farther = np.isnan(outermost) | (side[rows] * (edges[0] - outermost) > 0.0)
    for part, edge in zip(farthest, edges, strict=True):
        part[rows[farther]] = edge[farther]


def _ramps(points: Sequence[tuple[float, float]]) -> list[Cubic]:
    """Straight ramps between neighbouring stations and values; the last value holds on."""
    ramps = []
    for (s, value), (after_s, after) in zip(points, [*points[1:], *points[-1:]], strict=True):
        gap = after_s - s
        slope = (after - value) / gap if gap > 1e-9 else 0.0
        ramps.append(Cubic(s, value, slope, 0.0, 0.0))
    return ramps
