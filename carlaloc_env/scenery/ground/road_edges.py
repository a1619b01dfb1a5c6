"""Outer edges of all roads outside junctions: along which rails, poles and parked cars are lined up."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.polylines import densify, right_of
from carlaloc_env.map.lanes.speed_limits import road_limit_mps
from carlaloc_env.map.opendrive.records import Road
from carlaloc_env.scenery.ground.grade_levels import Levels, States
from carlaloc_env.scenery.ground.lane_strips import PAVED, Strip
from carlaloc_env.scenery.ground.terrain import Terrain, Zones


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
    edges = []
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
            edges.append(
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
    return edges


def rows_every(step_m: float, line: Array, end: int) -> Index:
    """Rows of a line (N, 3) with a point about every metre: half a step from its start, then a step apart.

    Args:
        step_m: Their distance, of which whole metres count [m].
        line: The line.
        end: Number of rows at the line's end that stay free.
    """
    return np.arange(int(step_m / 2), len(line) - end, int(step_m))
