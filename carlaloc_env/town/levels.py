"""Roads that leave the ground: which of them do, where, and what carries or covers them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from carlaloc_env.town.fields import EdgeField, GroundGrid
from carlaloc_env.town.level_graph import Crossing, RoadGraph, grown, runs
from carlaloc_env.town.polygons import Area, areas_only, strip_polygon
from carlaloc_env.town.sections import Strip
from carlaloc_env.town.terrain import BANK_SLOPE
from carlaloc_env.town.water import Water, water_areas, water_level_m

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
States = NDArray[np.int8]

REACH_M = 400.0
"""Roads farther than this from a crossing do not leave the ground for its sake [m]."""
FOLLOW_M = 200.0
"""Longest way on which a road comes back to the ground [m]."""
LEVEL_GRADE = 0.004
"""Grade below which a road that comes back to the ground has arrived."""
ON_GROUND_M = 0.3
"""Roads this near to the ground's height lie on it [m]."""
CLEARANCE_M = 4.5
"""Free height under a roof [m]."""
ROOF_M = 0.4
"""Thickness of the roof of an underpass [m]."""
COVER_REACH_M = 30.0
"""Farthest that an underpass stays roofed from the road that crosses it [m]."""
WALL_M = 0.3
"""Thickness of walls beside sunken and raised roads [m]."""
OPEN_M = 3.4
"""A road at least this high above a town's ground stands on piers, a lower one between walls [m]."""
LANDING_M = 1.5
"""Decks lower than this over the ground lie on it [m]."""
ABUTMENT_M = 3.5
"""Distance of abutments from the road that passes below [m]."""
WING_M = 14.0
"""Distance from the road below up to which an embankment stands between walls [m]."""
SHORT_GAP_M = 9
"""Shorter stretches between two open ones are open too [m]."""
_BANK_ZONES = ("rural", "highway", "park")
_EASE_M = 12.0


class State(IntEnum):
    """What is below or beside a sample of a road."""

    GROUND = 0
    """It lies on the ground."""
    SUNKEN = 1
    """It lies in a cut between walls, or below a roof."""
    OPEN = 2
    """It stands on piers."""
    FILLED = 3
    """It stands between retaining walls."""
    BANK = 4
    """It lies on an embankment whose sides are ground."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stretch:
    """Sunken part of a strip; lines run with growing s, one point per metre."""

    left_m: Array
    """Left edge of the paved part at its top [m], shape (N, 3)."""
    right_m: Array
    """Right edge [m], shape (N, 3)."""
    left_top_m: Array
    """The same with the height of the ground beside it [m], shape (N, 3)."""
    right_top_m: Array
    """The same for the right edge [m], shape (N, 3)."""
    detached: Mask
    """Where the ground goes on above the road, shape (N,)."""

    def area(self, where: Mask, wider_m: float = 0.0) -> Area:
        """Plan-view area of the runs of points that hold `where`."""
        parts = [strip_polygon(self.left_m[a:b], self.right_m[a:b]) for a, b in runs(where) if b - a > 1]
        return shapely.buffer(shapely.union_all(parts), wider_m, join_style="mitre")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Levels:
    """What leaves the ground in a town."""

    graph: RoadGraph
    """Samples of all roads."""
    state: States
    """`State` of each sample, shape (M,)."""
    lift_m: Array
    """Height of each sample above the ground or the water [m], shape (M,)."""
    stretches: tuple[Stretch, ...]
    """Sunken parts."""
    upper: Area
    """Paved areas that cross above a sunken stretch."""
    waters: tuple[Water, ...]
    """Lakes, rivers and harbours."""

    def area(self, *states: State) -> Area:
        """Plan-view area of all strips where they have one of some states."""
        return _area(self.graph, np.isin(self.state, states))

    def landings(self) -> Area:
        """Ends of decks that lie on the ground itself, beside a water."""
        return _area(self.graph, (self.state == State.OPEN) & (self.lift_m < LANDING_M))

    def overhead(self) -> dict[int, Area]:
        """What of each strip outside junctions stands above the ground, by the strip's number."""
        graph = self.graph
        up = np.isin(self.state, (State.OPEN, State.FILLED)) & ~graph.junction
        return {int(k): _area(graph, up & (graph.strip == k)) for k in np.unique(graph.strip[up])}

    def states_at(self, strip: int, s_m: Array) -> States:
        """State of a strip at stations, shape (N,)."""
        rows = self.graph.rows(strip)
        if rows.start == rows.stop:
            return np.zeros(len(s_m), dtype=np.int8)
        at = np.searchsorted(self.graph.s_m[rows], s_m).clip(0, rows.stop - rows.start - 1)
        result: States = self.state[rows][at]
        return result

    def ground_lines(self, strip: int) -> list[Array]:
        """Outer edges of a strip where it lies on the ground, each (N, 3)."""
        return self._lines(strip, State.GROUND)

    def bank_lines(self, strip: int) -> list[Array]:
        """Outer edges of a strip where it lies on an embankment, each (N, 3)."""
        return self._lines(strip, State.BANK)

    def _lines(self, strip: int, state: State) -> list[Array]:
        rows = self.graph.rows(strip)
        parts = []
        for a, b in runs(self.state[rows] == state):
            own = slice(rows.start + a, rows.start + b)
            parts += [self.graph.left_m[own], self.graph.right_m[own]]
        return parts


def find_levels(
    strips: Sequence[Strip], low_m: Array, high_m: Array, zones: Sequence[tuple[str, Area]] = ()
) -> Levels:
    """What leaves the ground: from the places where roads cross far above each other, and from the waters.

    Args:
        strips: All roads.
        low_m: South-western corner of the town [m], shape (2,).
        high_m: North-eastern corner [m], shape (2,).
        zones: Kinds of scenery with their areas.
    """
    graph = RoadGraph(strips)
    crossings = graph.crossings(strips)
    raised, sunken = _regions(graph, crossings)
    basins = water_areas(zones)
    over = _over_water(graph, basins)
    on_ground = ~(raised | sunken | grown_in_strips(graph, over >= 0, 2))
    grid = GroundGrid(_points(graph, on_ground), low_m, high_m)
    waters = _waters(graph, basins, over, grid)
    ground_m = grid.height(graph.middle_m)
    for number, water in enumerate(waters):
        ground_m[over == number] = water.level_m
    lift = graph.middle_m[:, 2] - ground_m
    state = np.zeros(len(lift), dtype=np.int8)
    state[sunken & (lift < -ON_GROUND_M)] = State.SUNKEN
    high = raised & (lift > ON_GROUND_M)
    state[high] = _carried(graph, high, lift, zones)
    state[grown_in_strips(graph, over >= 0, 2)] = State.OPEN
    _settle(graph, state, lift, strips)
    places = np.array([crossing.point_m for crossing in crossings]).reshape(-1, 2)
    cuts = tuple(_stretches(graph, state, grid, places))
    above = {graph.strip[c.high] for c in crossings if sunken[c.low]}
    return Levels(
        graph=graph,
        state=state,
        lift_m=lift,
        stretches=cuts,
        upper=areas_only(shapely.union_all([graph.prints[k] for k in sorted(above)])),
        waters=_shrunk(waters, graph, state),
    )


def grown_in_strips(graph: RoadGraph, mask: Mask, rows: int) -> Mask:
    """The mask with some more rows at both ends of each run, but never over a strip's end."""
    wide = mask.copy()
    for a, b in zip(graph.first[:-1], graph.first[1:], strict=True):
        if mask[a:b].any():
            wide[a:b] = grown(mask[a:b], rows)
    return wide


def _regions(graph: RoadGraph, crossings: Sequence[Crossing]) -> tuple[Mask, Mask]:
    """Rows that are raised and rows that are sunken, (M,) each.

    At each crossing the smaller of two sets leaves the ground: all that is joined to the upper road above
    half the height between both, or all that is joined to the lower road below it. A set from which no
    road leads to the other height is itself the ground.
    """
    z = graph.middle_m[:, 2]
    raised, sunken = np.zeros(len(z), dtype=bool), np.zeros(len(z), dtype=bool)
    for crossing in crossings:
        if raised[crossing.high] or sunken[crossing.low]:
            continue
        half = 0.5 * (z[crossing.low] + z[crossing.high])
        up = graph.component(z > half, crossing.high)
        down = graph.component(z < half, crossing.low)
        lifted = (not graph.leads_out(up), up.sum()) <= (not graph.leads_out(down), down.sum())
        near = np.hypot(*(graph.middle_m[:, :2] - crossing.point_m).T) < REACH_M
        if lifted:
            raised |= _followed(graph, up & near, z)
        else:
            sunken |= _followed(graph, down & near, -z)
    return raised, sunken


def _followed(graph: RoadGraph, region: Mask, height: Array) -> Mask:
    """The region with the roads that lead out of it, as far as they go on falling (`height` sinks)."""
    wide = region.copy()
    front = [(int(row), 0.0) for row in np.flatnonzero(region)]
    while front:
        row, gone = front.pop()
        for other in graph.neighbours(row):
            if wide[other] or graph.junction[other]:
                continue
            gap = float(np.hypot(*(graph.middle_m[other] - graph.middle_m[row])[:2]))
            falls = height[row] - height[other] > LEVEL_GRADE * gap
            if (falls or gap < 0.01) and gone + gap < FOLLOW_M:
                wide[other] = True
                front.append((int(other), gone + gap))
    return wide


def _over_water(graph: RoadGraph, basins: Sequence[Area]) -> NDArray[np.int64]:
    """Number of the water below each row, −1 over land, (M,)."""
    over = np.full(len(graph.strip), -1, dtype=np.int64)
    for number, basin in enumerate(basins):
        shapely.prepare(basin)
        inside = [shapely.contains_xy(basin, p[:, 0], p[:, 1]) for p in
                  (graph.left_m, graph.middle_m, graph.right_m)]  # fmt: skip
        over[inside[1] & (inside[0] | inside[2]) | (inside[0] & inside[2])] = number
    return over


def _waters(
    graph: RoadGraph, basins: Sequence[Area], over: NDArray[np.int64], grid: GroundGrid
) -> tuple[Water, ...]:
    found = []
    for number, basin in enumerate(basins):
        rim = shapely.get_coordinates(shapely.segmentize(shapely.boundary(basin), 5.0))
        bridges = graph.middle_m[over == number, 2]
        found.append(Water(area=basin, level_m=water_level_m(basin, grid.height(rim), bridges)))
    return tuple(found)


def _shrunk(waters: Sequence[Water], graph: RoadGraph, state: States) -> tuple[Water, ...]:
    """The waters without what is paved on the land beside them."""
    if not waters:
        return ()
    on_land = np.isin(state, (State.GROUND, State.FILLED, State.BANK))
    land = shapely.buffer(_area(graph, on_land), 1.0, join_style="mitre")
    parts = [
        Water(area=areas_only(shapely.difference(water.area, land), 20.0), level_m=water.level_m)
        for water in waters
    ]
    return tuple(part for part in parts if not part.area.is_empty)


def _carried(graph: RoadGraph, high: Mask, lift: Array, zones: Sequence[tuple[str, Area]]) -> States:
    """State of the raised rows: piers, walls or an embankment."""
    middle = graph.middle_m[high]
    gap = _gap_below(graph, high)
    country = np.zeros(len(middle), dtype=bool)
    for kind, area in zones:
        if kind in _BANK_ZONES:
            shapely.prepare(area)
            country |= shapely.contains_xy(area, middle[:, 0], middle[:, 1])
    state = np.where(lift[high] > OPEN_M, State.OPEN, State.FILLED).astype(np.int8)
    near = gap < np.maximum(WING_M, BANK_SLOPE * lift[high] + 2.0)
    bank = np.where(gap < ABUTMENT_M, State.OPEN, np.where(near, State.FILLED, State.BANK))
    return np.where(country, bank, state).astype(np.int8)


def _gap_below(graph: RoadGraph, high: Mask) -> Array:
    """Distance of each raised row's cross-section from anything paved on the ground below it [m]."""
    shares = np.linspace(0.0, 1.0, 7)[:, None, None]
    low = np.flatnonzero(~high)
    across = graph.left_m[low] + shares * (graph.right_m - graph.left_m)[low]
    points = across.reshape(-1, 3)
    tree = cKDTree(points[:, :2])
    bars = graph.left_m[high] + shares * (graph.right_m - graph.left_m)[high]
    best = np.full(bars.shape[1], np.inf)
    for bar in bars:
        distance, index = tree.query(bar[:, :2], k=12, distance_upper_bound=30.0)
        index = np.minimum(index, len(points) - 1)
        below = bar[:, None, 2] - points[index, 2] > 1.5
        best = np.minimum(best, np.where(below, distance, np.inf).min(axis=1))
    return best


def _settle(graph: RoadGraph, state: States, lift: Array, strips: Sequence[Strip]) -> None:
    """Close short gaps between open stretches, and give each junction one state."""
    for a, b in zip(graph.first[:-1], graph.first[1:], strict=True):
        own = state[a:b]
        filled = own == State.FILLED
        for i, j in runs(filled):
            inner = i > 0 and j < len(own) and own[i - 1] == State.OPEN and own[j] == State.OPEN
            if inner and j - i < SHORT_GAP_M:
                own[i:j] = State.OPEN
    groups: dict[str, list[int]] = {}
    for number, strip in enumerate(strips):
        if strip.junction_id is not None:
            groups.setdefault(strip.junction_id, []).append(number)
    for group in groups.values():
        rows = np.concatenate([np.arange(graph.first[k], graph.first[k + 1]) for k in group])
        if not len(rows) or (state[rows] == State.SUNKEN).any():
            continue
        counts = np.bincount(state[rows], minlength=5)
        common = int(np.argmax(counts))
        if counts[common] < len(rows):
            up = counts[State.OPEN] + counts[State.FILLED]
            mean = float(lift[rows].mean())
            if up > 0.5 * len(rows):
                common = State.OPEN if mean > OPEN_M or counts[State.OPEN] > 0 else State.FILLED
            state[rows] = common


def _stretches(graph: RoadGraph, state: States, grid: GroundGrid, crossings: Array) -> list[Stretch]:
    found = []
    for strip in np.unique(graph.strip[state == State.SUNKEN]):
        rows = graph.rows(int(strip))
        for a, b in runs(grown(state[rows] == State.SUNKEN)):
            if b - a > 2:
                found.append(_stretch(graph, state, slice(rows.start + a, rows.start + b), grid, crossings))
    return found


def _stretch(graph: RoadGraph, state: States, rows: slice, grid: GroundGrid, crossings: Array) -> Stretch:
    left, right, s = graph.left_m[rows], graph.right_m[rows], graph.s_m[rows]
    # The ends of a cut are where the road is on the ground again; it may go on over the next road.
    ease = np.ones(len(s))
    for end, way in ((rows.start, s - s[0]), (rows.stop - 1, s[-1] - s)):
        beyond = [n for n in graph.neighbours(end) if not rows.start <= n < rows.stop]
        if not any(state[n] == State.SUNKEN for n in beyond):
            ease = np.minimum(ease, np.clip(way / _EASE_M, 0.0, 1.0))
    tops = []
    for edge in (left, right):
        top = edge.copy()
        top[:, 2] += (np.maximum(grid.height(edge), edge[:, 2]) - edge[:, 2]) * ease
        tops.append(top)
    depth = np.minimum(tops[0][:, 2] - left[:, 2], tops[1][:, 2] - right[:, 2])
    middle = graph.middle_m[rows][:, None, :2]
    near = np.hypot(*np.moveaxis(middle - crossings[None], -1, 0)).min(axis=1) < COVER_REACH_M
    return Stretch(
        left_m=left,
        right_m=right,
        left_top_m=tops[0],
        right_top_m=tops[1],
        detached=(depth >= CLEARANCE_M + ROOF_M) & near,
    )


def _area(graph: RoadGraph, mask: Mask) -> Area:
    """Plan-view area of all strips where a mask holds."""
    parts = []
    for strip in np.unique(graph.strip[mask]):
        rows = graph.rows(int(strip))
        for a, b in runs(mask[rows]):
            own = slice(rows.start + a, min(rows.start + b + 1, rows.stop))
            if own.stop - own.start > 1:
                parts.append(strip_polygon(graph.left_m[own], graph.right_m[own]))
    return areas_only(shapely.union_all(parts)) if parts else shapely.MultiPolygon()


def _points(graph: RoadGraph, mask: Mask) -> Array:
    return np.concatenate([graph.left_m[mask], graph.right_m[mask]])


def level_fields(
    strips: Sequence[Strip], levels: Levels, lines_of: Sequence[Sequence[Array]]
) -> tuple[EdgeField, EdgeField | None]:
    """Heights of the edges of what lies on the ground or below it, and of what is carried above it.

    Args:
        strips: All roads.
        levels: What leaves the ground.
        lines_of: Edges (N, 3) of each strip, a point per station of the strip.
    """
    low: list[Array] = []
    high: list[Array] = []
    for number, (strip, lines) in enumerate(zip(strips, lines_of, strict=True)):
        state = levels.states_at(number, strip.s_m)
        up = (state == State.OPEN) | (state == State.FILLED)
        for mask, found in ((up, high), (~up, low)):
            for a, b in runs(grown(mask)):
                found += [line[a:b] for line in lines]
    return EdgeField(low), EdgeField(high) if high else None
