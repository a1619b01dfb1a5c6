"""The fall of carriageways to their sides, where a map says nothing about it."""

from collections.abc import Sequence

import numpy as np

from carlaloc_env.core.array_types import Array, Index, Mask
from carlaloc_env.core.point_tree import point_tree
from carlaloc_env.map.opendrive.cubic_table import CubicTable
from carlaloc_env.map.opendrive.lane_boundaries import LaneEdges
from carlaloc_env.map.opendrive.records import Road, RoadLink
from carlaloc_env.map.opendrive.reference_line import PlanView

FALL = 0.025
"""Fall of a carriageway from its middle to its edges, for the rain (RAA, RASt 06: 2.5 %)."""
GUTTER_FALL = 0.06
"""The same of gutters (AASHTO, Geometric Design of Highways and Streets: 5 to 8 %)."""
GUTTER_M = 0.65
"""Shoulders of at most this width beside a kerb are gutters [m]."""
KERBED = frozenset({"sidewalk", "walking", "curb"})
"""Lane types that a kerb parts from the carriageway."""
FADE_M = 25.0
"""Length over which it begins and ends before junctions, which are level across [m]."""
GAP_M = 0.05
"""Roads whose middles lie this far apart where they meet are level there [m]."""
BESIDE = frozenset({"none", "sidewalk", "walking", "curb", "border", "median"})
"""Lane types that do not belong to the carriageway: they stay level behind its edge."""
BESIDE_M, STEP_M = 4.0, 0.02
"""Carriageways this near to each other stay level where their edges would differ by more than a step [m]."""
_TILT_RAD = 1e-4
_STEP_M = 2.0


class Crossfall:
    """A roof with its ridge along lane 0, on stretches of roads without superelevation or shape.

    Gutters along kerbs fall more. Roads of junctions are level across, and so are others where they run close
    beside or across another one.

    Args:
        roads: Roads of the map.
        plan_view: Their reference lines.
        edges: Their lanes.
        elevation: Their heights.
        tilt: Their superelevations.
    """

    def __init__(
        self,
        roads: Sequence[Road],
        plan_view: PlanView,
        edges: LaneEdges,
        elevation: CubicTable,
        tilt: CubicTable,
    ) -> None:
        self._edges = edges
        self._length: Array = np.array([road.length_m for road in roads])
        counts = np.maximum((self._length / _STEP_M).astype(np.int64) + 2, 2)
        stations = [
            np.linspace(0.0, length, count) for length, count in zip(self._length, counts, strict=True)
        ]
        # One axis for all roads, on which one interpolation finds any width.
        self._begin: Array = np.concatenate([[0.0], np.cumsum(self._length + 1.0)[:-1]])
        number, s = np.repeat(np.arange(len(roads)), counts), np.concatenate(stations)
        self._axis: Array = self._begin[number] + s
        sides = {side: self._carriageway(roads, number, s, side) for side in (1, -1)}
        self._reach = {side: reach for side, (reach, _) in sides.items()}
        self._gutter = {side: gutter for side, (_, gutter) in sides.items()}
        flat: Mask = np.array([road.junction_id is not None or bool(road.shape) for road in roads], bool)
        middles = self._middle(plan_view, np.zeros(len(roads))), self._middle(plan_view, self._length)
        level_at = [[_is_level(roads, flat, middles, n, end) for n in range(len(roads))] for end in (0, 1)]
        first_m = np.where(level_at[0], 0.0, -FADE_M)
        last_m = np.where(level_at[1], self._length, self._length + FADE_M)
        # Before the first and after the last of these stations a road is level across.
        self._span = np.stack([first_m, last_m], axis=-1)
        z = elevation.evaluate(number, s)[0]
        level = np.abs(tilt.evaluate(number, s)[0]) > _TILT_RAD
        level |= self._beside_others(roads, plan_view, number, s, z, flat)
        for n in np.unique(number[level]):
            rows = number == n
            self._span[n] = _longest_free(s[rows], level[rows], self._span[n])
        self._fall: Array = np.where(flat | (np.diff(self._span)[:, 0] < FADE_M), 0.0, FALL)

    def evaluate(self, road: Index, s_m: Array, t_m: Array) -> tuple[Array, Array, Array]:
        """Height [m] and its derivatives by s and by t, each (M,)."""
        middle, slope, _ = self._edges.lane_offset(road, s_m)
        aside = t_m - middle
        side = np.sign(aside)
        at = self._begin[road] + s_m
        reach, gutter = (self._at(at, side, width) for width in (self._reach, self._gutter))
        distance = np.minimum(np.abs(aside), reach)
        inside = np.abs(aside) < reach
        fall, fall_slope = self._along(road, s_m)
        more = (GUTTER_FALL - FALL) / FALL
        sunk = np.maximum(distance - (reach - gutter), 0.0) * more
        height = -fall * (distance + sunk)
        by_distance = 1.0 + more * (sunk > 0.0)
        widening, gutter_widening = (self._by_s(at, side, width) for width in (self._reach, self._gutter))
        outwards = np.where(inside, -side * slope, widening)
        sunk_by_s = np.where(sunk > 0.0, outwards - widening + gutter_widening, 0.0) * more
        by_s = -fall_slope * (distance + sunk) - fall * (outwards + sunk_by_s)
        return height, by_s, np.where(inside, -fall * side * by_distance, 0.0)

    def _at(self, at: Array, side: Array, width: dict[int, Array]) -> Array:
        """A width on a side at places of the common axis [m]."""
        left, right = (np.interp(at, self._axis, width[which]) for which in (1, -1))
        return np.where(side > 0, left, right)

    def _by_s(self, at: Array, side: Array, width: dict[int, Array]) -> Array:
        """Its derivative by s."""
        return (self._at(at + 0.25, side, width) - self._at(at - 0.25, side, width)) / 0.5

    def _along(self, road: Index, s_m: Array) -> tuple[Array, Array]:
        """Fall and its derivative by s."""
        rise, rise_slope = _ramp(s_m - self._span[road, 0])
        end, end_slope = _ramp(self._span[road, 1] - s_m)
        fall = self._fall[road]
        return fall * rise * end, fall * (rise_slope * end - rise * end_slope)

    def _carriageway(self, roads: Sequence[Road], number: Index, s: Array, side: int) -> tuple[Array, Array]:
        """Distance from lane 0 to the carriageway's edge, left (1) or right (−1), and gutter's width [m]."""
        lane = np.full(len(s), -1, dtype=np.int64)
        inner = lane.copy()
        for n, road in enumerate(roads):
            rows = np.flatnonzero(number == n)
            starts = [section.s_m for section in road.sections]
            own = np.clip(np.searchsorted(starts, s[rows] + 1e-9, side="right") - 1, 0, None)
            for k, section in enumerate(road.sections):
                types = {abs(item.id): item.type for item in section.lanes if item.id * side > 0}
                paved = [i for i, kind in types.items() if kind not in BESIDE]
                if not paved:
                    continue
                last = max(paved)
                lane[rows[own == k]] = self._edges.index[n, k, side * last]
                if types[last] == "shoulder" and types.get(last + 1) in KERBED and types.get(last - 1):
                    inner[rows[own == k]] = self._edges.index[n, k, side * (last - 1)]
        reach, width = np.zeros(len(s)), np.zeros(len(s))
        has = np.flatnonzero(lane >= 0)
        middle = self._edges.lane_offset(number, s).t_m
        reach[has] = np.maximum(side * (self._edges.outer(lane[has], s[has]).t_m - middle[has]), 0.0)
        has = np.flatnonzero(inner >= 0)
        inside = np.maximum(side * (self._edges.outer(inner[has], s[has]).t_m - middle[has]), 0.0)
        width[has] = np.maximum(reach[has] - inside, 0.0)
        return reach, np.where(width <= GUTTER_M, width, 0.0)

    def _beside_others(
        self, roads: Sequence[Road], plan: PlanView, number: Index, s: Array, z: Array, flat: Mask
    ) -> Mask:
        """Stations where a carriageway's edge would leave a step to another road's close by, (N,)."""
        pose = plan.evaluate(number, s)
        middle = self._edges.lane_offset(number, s).t_m
        points, drops, rows = [], [], []
        for side in (1, -1):
            t = middle + side * self._reach[side]
            drop = FALL * self._reach[side] + (GUTTER_FALL - FALL) * self._gutter[side]
            points.append(np.stack([*pose.beside(t), z], axis=-1))
            drops.append(np.where(flat[number], 0.0, drop))
            rows.append(np.arange(len(s)))
        xyz, drop, row = np.concatenate(points), np.concatenate(drops), np.concatenate(rows)
        use = np.isfinite(xyz).all(axis=1)
        xyz, drop, row = xyz[use], drop[use], row[use]
        stepped = np.zeros(len(s), dtype=bool)
        pairs = point_tree(xyz).query_pairs(BESIDE_M, output_type="ndarray")
        a, b = number[row[pairs[:, 0]]], number[row[pairs[:, 1]]]
        step = np.abs(drop[pairs[:, 0]] - drop[pairs[:, 1]]) > STEP_M
        pairs = pairs[(a != b) & step & ~np.isin(a * len(roads) + b, _linked(roads))]
        stepped[row[pairs.ravel()]] = True
        return stepped

    def _middle(self, plan: PlanView, s_m: Array) -> Array:
        """Points of all roads' lane 0, each at a station of its own (N,) [m], shape (N, 2)."""
        road = np.arange(len(s_m))
        offset = self._edges.lane_offset(road, s_m)
        return np.stack(plan.evaluate(road, s_m).beside(offset.t_m), axis=-1)


def _is_level(
    roads: Sequence[Road], flat: Mask, middles_m: tuple[Array, Array], number: int, end: int
) -> bool:
    """Whether a road must be level across at an end: a junction, a road without fall, another middle.

    Args:
        roads: All roads.
        flat: Which of them are level across all along, (N,).
        middles_m: Points of their lane 0 at start and end [m], (N, 2) each.
        number: The road.
        end: Its end: 0 start, 1 end.
    """
    road = roads[number]
    link: RoadLink | None = road.successor if end else road.predecessor
    if link is None:
        return False
    others = [n for n, other in enumerate(roads) if other.id == link.element_id]
    if link.element_type == "junction" or link.contact is None or not others or flat[others[0]]:
        return True
    far = middles_m[0 if link.contact == "start" else 1][others[0]]
    return not float(np.hypot(*(middles_m[end][number] - far))) < GAP_M


def _ramp(distance_m: Array) -> tuple[Array, Array]:
    """Smooth step from 0 to 1 over `FADE_M`, and its derivative."""
    u = np.clip(distance_m / FADE_M, 0.0, 1.0)
    return u * u * (3.0 - 2.0 * u), 6.0 * u * (1.0 - u) / FADE_M


def _linked(roads: Sequence[Road]) -> Index:
    """Pairs of roads of which one goes on in the other: first number × count + second, both ways round."""
    number = {road.id: n for n, road in enumerate(roads)}
    pairs = []
    for n, road in enumerate(roads):
        for link in (road.predecessor, road.successor):
            if link is not None and link.element_type == "road" and link.element_id in number:
                other = number[link.element_id]
                pairs += [n * len(roads) + other, other * len(roads) + n]
    return np.array(pairs, dtype=np.intp)


def _longest_free(s_m: Array, level: Mask, span: Array) -> Array:
    """First and last station of the longest stretch that need not be level."""
    edges = np.flatnonzero(level)
    starts = np.concatenate([span[:1], s_m[edges]])
    ends = np.concatenate([s_m[edges], span[1:]])
    best = int(np.argmax(ends - starts))
    return np.array([starts[best], ends[best]])
