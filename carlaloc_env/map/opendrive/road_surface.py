"""Road coordinates (road, s, t, h) to world points and tangents, for arrays of points at once."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.map.opendrive.crossfall import Crossfall
from carlaloc_env.map.opendrive.cubic_table import CubicTable
from carlaloc_env.map.opendrive.lane_boundaries import Edge, LaneEdges
from carlaloc_env.map.opendrive.records import Road, ShapeRecord
from carlaloc_env.map.opendrive.reference_line import PlanView
from carlaloc_env.road.road_profile import Relief


class SurfaceCurve(NamedTuple):
    """Points of curves on roads and how they run on, in the direction of growing s."""

    position_m: NDArray[np.float64]
    """World points, (M, 3)."""
    heading_rad: Array
    """True heading of the curve, not wrapped, (M,)."""
    slope: Array
    """Rise per metre of the curve in the plane, (M,)."""
    curvature_radpm: Array
    """Curvature of the curve in the plane [1/m], (M,)."""
    stretch: Array
    """Metres of the curve in the plane per metre of s, (M,)."""


class RoadSurface:
    """The roads of a map as surfaces; roads are numbered in file order."""

    def __init__(self, roads: Sequence[Road], relief: Relief | None = None) -> None:
        """Tabulates all profiles of the roads.

        With a `relief`, which lies on top of what the file says, roads that the file leaves level across
        fall to their sides.
        """
        self.relief = relief
        self.plan_view = PlanView(roads)
        self.edges = LaneEdges(roads)
        self._elevation = CubicTable([road.elevation for road in roads])
        self._tilt = CubicTable([road.superelevation for road in roads])
        self._shapes = {n: LateralShape(road.shape) for n, road in enumerate(roads) if road.shape}
        self._crossfall: Crossfall | None = None
        if relief is not None:
            self._crossfall = Crossfall(roads, self.plan_view, self.edges, self._elevation, self._tilt)

    def position(self, road: Index, s_m: Array, t_m: Array, h_m: Array | float = 0.0) -> NDArray[np.float64]:
        """World points (M, 3) of road coordinates.

        Args:
            road: Road numbers, (M,).
            s_m: Along the reference line [m], (M,).
            t_m: To its left [m], (M,).
            h_m: Above the road surface, square to it [m].
        """
        line = self.plan_view.evaluate(road, s_m)
        z, _, _ = self._elevation.evaluate(road, s_m)
        tilt, _, _ = self._tilt.evaluate(road, s_m)
        h = h_m + self._shape(road, s_m, t_m)[0]
        across = t_m * elementary.cos(tilt) - h * elementary.sin(tilt)
        up = z + t_m * elementary.sin(tilt) + h * elementary.cos(tilt)
        points = np.stack([*line.beside(across), up], axis=-1)
        if self.relief is not None:
            points[:, 2] += self.relief.heights(points)[:, 0]
        return points

    def heading(self, road: Index, s_m: Array) -> Array:
        """Heading of the reference line [rad], (M,)."""
        return self.plan_view.evaluate(road, s_m).heading_rad

    def curve(
        self, road: Index, s_m: Array, edge: Edge, h_m: Array | float = 0.0, h_slope: Array | float = 0.0
    ) -> SurfaceCurve:
        """Points and true tangents of curves t(s), h(s) on roads.

        With τ the plan-view offset, the tangent is (1 − κτ)·e_s + τ'·e_t.
        """
        line = self.plan_view.evaluate(road, s_m)
        z, z1, _ = self._elevation.evaluate(road, s_m)
        tilt, tilt1, _ = self._tilt.evaluate(road, s_m)
        t, t1, t2 = edge
        shape, shape_s, shape_t = self._shape(road, s_m, t)
        h, h1 = h_m + shape, h_slope + shape_s + shape_t * t1
        c, s = elementary.cos(tilt), elementary.sin(tilt)
        across = t * c - h * s
        across1 = t1 * c - h1 * s - (t * s + h * c) * tilt1
        # The rest of τ'' needs third-order detail of tilted roads and changes no heading.
        across2 = t2 * c - 2.0 * t1 * s * tilt1
        k, rate = line.curvature_radpm, line.rate
        along = rate * (1.0 - k * across)
        along1 = -rate * (rate * line.curvature_slope * across + k * across1)
        stretch = np.maximum(np.sqrt(along * along + across1 * across1), 1e-9)
        turn = k * rate + (along * across2 - across1 * along1) / (stretch * stretch)
        rise = z1 + t1 * s + h1 * c + (t * c - h * s) * tilt1
        heading = line.heading_rad
        position = np.stack([*line.beside(across), z + t * s + h * c], axis=-1)
        if self.relief is not None:
            ground = self.relief.heights(position)
            position[:, 2] += ground[:, 0]
            ahead, left = self._slopes(ground, heading)
            rise = rise + ahead * along + left * across1
        return SurfaceCurve(
            position, heading + elementary.arctan2(across1, along), rise / stretch, turn / stretch, stretch
        )

    def lane_centre(self, lane: Index, s_m: Array) -> SurfaceCurve:
        """Centre lines of lanes, lane heights included."""
        inner, outer, inner_slope, outer_slope = self.edges.heights(lane, s_m)
        centre = self.edges.centre(lane, s_m)
        h, slope = 0.5 * (inner + outer), 0.5 * (inner_slope + outer_slope)
        return self.curve(self.edges.road[lane], s_m, centre, h, slope)

    def lane_bank(self, lane: Index, s_m: Array) -> Array:
        """Rise per metre to the left, across lanes at their middles: tilt, shape and lane heights, (M,)."""
        road = self.edges.road[lane]
        inner, outer, _, _ = self.edges.heights(lane, s_m)
        width = np.maximum(self.edges.width(lane, s_m), 0.05)
        own = self.edges.side[lane] * (outer - inner) / width
        centre = self.edges.centre(lane, s_m).t_m
        shape = self._shape(road, s_m, centre)[2]
        bank: Array = elementary.tan(self.tilt_rad(road, s_m) + elementary.arctan(shape + own))
        if self.relief is not None:
            ground = self.relief.heights(self.position(road, s_m, centre))
            bank += self._slopes(ground, self.heading(road, s_m))[1]
        return bank

    def tilt_rad(self, road: Index, s_m: Array) -> Array:
        """Superelevation [rad], left side up positive, (M,)."""
        return self._tilt.evaluate(road, s_m)[0]

    def slope(self, road: Index, s_m: Array) -> Array:
        """Rise of the reference line per metre of s, (M,)."""
        return self._elevation.evaluate(road, s_m)[1]

    @staticmethod
    def _slopes(ground: Array, heading_rad: Array) -> tuple[Array, Array]:
        """Rise of the relief along the reference line and to its left, (M,) each."""
        cos, sin = elementary.cos(heading_rad), elementary.sin(heading_rad)
        return cos * ground[:, 1] + sin * ground[:, 2], cos * ground[:, 2] - sin * ground[:, 1]

    def _shape(self, road: Index, s_m: Array, t_m: Array) -> tuple[Array, Array, Array]:
        if self._crossfall is None:
            height, by_s, by_t = np.zeros(len(road)), np.zeros(len(road)), np.zeros(len(road))
        else:
            height, by_s, by_t = self._crossfall.evaluate(road, s_m, t_m)
        for number, shape in self._shapes.items():
            own = np.flatnonzero(road == number)
            if len(own):
                height[own], by_s[own], by_t[own] = shape.evaluate(s_m[own], t_m[own])
        return height, by_s, by_t


class LateralShape:
    """Cross-section profiles of one road, blended linearly along s."""

    def __init__(self, records: Sequence[ShapeRecord]) -> None:
        """Groups the records by s; they ascend in s, then t."""
        rows = np.array([(r.s_m, r.t_m, r.a, r.b, r.c, r.d) for r in records], dtype=np.float64)
        self._stations, first, count = np.unique(rows[:, 0], return_index=True, return_counts=True)
        self._first, self._count = first.astype(np.int64), count.astype(np.int64)
        self._t = np.ascontiguousarray(rows[:, 1])
        self._coefficients = np.ascontiguousarray(rows[:, 2:].T)

    def evaluate(self, s_m: Array, t_m: Array) -> tuple[Array, Array, Array]:
        """Height [m] and its derivatives by s and by t, each (M,)."""
        last = len(self._stations) - 1
        low = np.clip(np.searchsorted(self._stations, s_m, side="right") - 1, 0, last).astype(np.int64)
        high = np.minimum(low + 1, last)
        gap = self._stations[high] - self._stations[low]
        safe = np.where(gap > 0.0, gap, 1.0)
        share = np.clip(np.where(gap > 0.0, (s_m - self._stations[low]) / safe, 0.0), 0.0, 1.0)
        a, a_t = self._profile(low, t_m)
        b, b_t = self._profile(high, t_m)
        inside = (gap > 0.0) & (share > 0.0) & (share < 1.0)
        return a + share * (b - a), np.where(inside, (b - a) / safe, 0.0), a_t + share * (b_t - a_t)

    def _profile(self, station: Index, t_m: Array) -> tuple[Array, Array]:
        first, count = self._first[station], self._count[station]
        row = first.copy()
        for step in range(1, int(count.max())):
            nearer = (step < count) & (self._t[np.minimum(first + step, len(self._t) - 1)] <= t_m)
            row = np.where(nearer, first + step, row)
        dt = t_m - self._t[row]
        a, b, c, d = (k[row] for k in self._coefficients)
        return a + dt * (b + dt * (c + dt * d)), b + dt * (2.0 * c + 3.0 * dt * d)
