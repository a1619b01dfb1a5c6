"""Roads that leave the ground: where each of them lies on it, in it or above it.

Outer edges of all roads outside junctions: along which rails, poles and parked cars are lined up.

Stretches of road that lie in a cut between walls, or below a roof.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import shapely
from numpy.typing import NDArray

from carlaloc_env.core.areas import Area, areas_only, strip_polygon
from carlaloc_env.core.array_types import Array, Index, Mask
from carlaloc_env.core.polylines import densify, right_of
from carlaloc_env.map.lanes.lane_network import CLEARANCE_M
from carlaloc_env.map.lanes.lanes import road_limit_mps
from carlaloc_env.map.opendrive.records import Road
from carlaloc_env.scenery.ground.grade_graph import RoadGraph, grown, runs
from carlaloc_env.scenery.ground.height_fields import EdgeField, GroundGrid
from carlaloc_env.scenery.ground.lane_strips import PAVED, Strip
from carlaloc_env.scenery.ground.terrain import Terrain, Zones
from carlaloc_env.scenery.ground.water import Water

States = NDArray[np.int8]
"""A `State` of each station."""

WALL_M = 0.3
"""Thickness of walls beside sunken and raised roads [m]."""
LANDING_M = 1.5
"""Decks lower than this over the ground lie on it [m]."""


class State(IntEnum):
    """The ground below or beside a sample of a road."""

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
    """Roads of a town that leave the ground, and its waters."""

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
        return strips_area(self.graph, np.isin(self.state, states))

    def landings(self) -> Area:
        """Ends of decks that lie on the ground itself, beside a water."""
        return strips_area(self.graph, (self.state == State.OPEN) & (self.lift_m < LANDING_M))

    def overhead(self) -> dict[int, Area]:
        """Part of each strip outside junctions that stands above the ground, by the strip's number."""
        graph = self.graph
        up = np.isin(self.state, (State.OPEN, State.FILLED)) & ~graph.junction
        return {int(k): strips_area(graph, up & (graph.strip == k)) for k in np.unique(graph.strip[up])}

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
            part = slice(rows.start + a, rows.start + b)
            parts += [self.graph.left_m[part], self.graph.right_m[part]]
        return parts


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


def strips_area(graph: RoadGraph, mask: Mask) -> Area:
    """Plan-view area of all strips where a mask holds."""
    parts = []
    for strip in np.unique(graph.strip[mask]):
        rows = graph.rows(int(strip))
        for a, b in runs(mask[rows]):
            part = slice(rows.start + a, min(rows.start + b + 1, rows.stop))
            if part.stop - part.start > 1:
                parts.append(strip_polygon(graph.left_m[part], graph.right_m[part]))
    return areas_only(shapely.union_all(parts)) if parts else shapely.MultiPolygon()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RoadEdge:
    """One side of one strip, a point per metre, with the free side on the right of the line."""

    name: str
    """Name of its random stream."""
    strip: Strip
    """The strip."""
    line_m: Array
    """Outer edge of all that is paved, at its top [m], shape (N, 3)."""
    right: Array
    """Unit vectors away from the road, shape (N, 2)."""
    state: States
    """`State` of the road, shape (N,)."""
    lift_m: Array
    """Height of the road above the ground [m], shape (N,)."""
    sidewalk: bool
    """Whether the outermost lane is a sidewalk."""
    limit_mps: float
    """Highest speed limit of the road [m/s]."""
    road_type: str
    """Type of the road in the map."""

    @property
    def traffic(self) -> Array:
        """Unit vectors along which the traffic beside the edge drives, shape (N, 2)."""
        along = np.stack([-self.right[:, 1], self.right[:, 0]], axis=-1)
        return -along if self.strip.left_hand_traffic else along


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Waysides:
    """The ground beside the roads of a town."""

    edges: Sequence[RoadEdge]
    """Edges of all roads outside junctions."""
    zones: Zones
    """Kinds of scenery with their areas."""
    ground: Terrain
    """Heights of the ground."""
    seed: int
    """Seed of the town."""


def road_edges(strips: Sequence[Strip], roads: Sequence[Road], levels: Levels) -> list[RoadEdge]:
    """Both edges of every strip outside junctions that is longer than 3 m."""
    found = []
    for number, strip in enumerate(strips):
        span = strip.span(PAVED)
        if strip.junction_id is not None or span is None or strip.s_m[-1] - strip.s_m[0] < 3.0:
            continue
        rows = levels.graph.rows(number)
        road = roads[strip.road]
        left, right = strip.lane_edges(span[0])[0], strip.lane_edges(span[1] - 1)[1]
        both = ((left[::-1], strip.s_m[::-1], span[0], "left"), (right, strip.s_m, span[1] - 1, "right"))
        for line, s, lane, side in both:
            even = densify(np.column_stack([line, s]), 1.0)
            if len(even) < 4:
                continue
            at = np.searchsorted(levels.graph.s_m[rows], even[:, 3]).clip(0, rows.stop - rows.start - 1)
            found.append(
                RoadEdge(
                    name=f"{strip.road_id}/{strip.section}/{side}",
                    strip=strip,
                    line_m=even[:, :3],
                    right=right_of(even[:, :2]),
                    state=levels.state[rows][at],
                    lift_m=levels.lift_m[rows][at],
                    sidewalk=strip.kind(lane) == "sidewalk",
                    limit_mps=road_limit_mps(road),
                    road_type=road.type,
                )
            )
    return found


def rows_every(step_m: float, line: Array, end: int) -> Index:
    """Rows of a line (N, 3) with a point about every metre: half a step from its start, then a step apart.

    Args:
        step_m: Their distance, of which whole metres count [m].
        line: The line.
        end: Number of rows at the line's end that stay free.
    """
    return np.arange(int(step_m / 2), len(line) - end, int(step_m))


ROOF_M = 0.4
"""Thickness of the roof of an underpass [m]."""
COVER_RANGE_M = 30.0
"""Farthest that an underpass stays roofed from the road that crosses it [m]."""
_EASE_M = 12.0


def cuttings(graph: RoadGraph, state: States, grid: GroundGrid, crossings: Array) -> list[Stretch]:
    """Sunken stretches of all strips.

    Args:
        graph: Samples of all roads.
        state: `State` of each sample, shape (M,).
        grid: Heights of the ground.
        crossings: Where roads cross far above each other [m], shape (K, 2).
    """
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
    for end, from_end_m in ((rows.start, s - s[0]), (rows.stop - 1, s[-1] - s)):
        beyond = [n for n in graph.neighbours(end) if not rows.start <= n < rows.stop]
        if not any(state[n] == State.SUNKEN for n in beyond):
            ease = np.minimum(ease, np.clip(from_end_m / _EASE_M, 0.0, 1.0))
    tops = []
    for edge in (left, right):
        top = edge.copy()
        top[:, 2] += (np.maximum(grid.height(edge), edge[:, 2]) - edge[:, 2]) * ease
        tops.append(top)
    depth = np.minimum(tops[0][:, 2] - left[:, 2], tops[1][:, 2] - right[:, 2])
    middle = graph.middle_m[rows][:, None, :2]
    near = np.hypot(*np.moveaxis(middle - crossings[None], -1, 0)).min(axis=1) < COVER_RANGE_M
    return Stretch(
        left_m=left,
        right_m=right,
        left_top_m=tops[0],
        right_top_m=tops[1],
        detached=(depth >= CLEARANCE_M + ROOF_M) & near,
    )
