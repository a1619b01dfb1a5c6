"""Levels of roads: where each of them lies on the ground, in it or above it."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import shapely
from numpy.typing import NDArray

from carlaloc_env.core.areas import Area, areas_only, strip_polygon
from carlaloc_env.core.array_types import Array, Mask
from carlaloc_env.scenery.ground.grade_graph import RoadGraph, grown, runs
from carlaloc_env.scenery.ground.height_fields import EdgeField
from carlaloc_env.scenery.ground.lane_strips import Strip
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

    def edges(self, state: State) -> list[Array]:
        """Outer edges of all strips where they have a state, each (N, 3)."""
        parts = []
        for strip in range(len(self.graph.prints)):
            rows = self.graph.rows(strip)
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
        for mask, edges in ((up, high), (~up, low)):
            for a, b in runs(grown(mask)):
                edges += [line[a:b] for line in lines]
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
