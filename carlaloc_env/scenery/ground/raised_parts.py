"""Roads above the ground: their areas, the heights of their edges, and the floor below them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from carlaloc_env.core.areas import Area, areas_only
from carlaloc_env.core.array_types import Array, Mask
from carlaloc_env.scenery.ground.grade_graph import runs
from carlaloc_env.scenery.ground.grade_levels import Levels, State
from carlaloc_env.scenery.ground.height_fields import EdgeField
from carlaloc_env.scenery.ground.paved_areas import JunctionArea
from carlaloc_env.scenery.ground.terrain import Terrain

DECK_M = 0.9
"""Thickness of a deck [m]."""
FOOTING_M = 0.8
"""How far walls and piers reach into the ground [m]."""
SHORE_M = 8.0
"""Things this far from a water are near it [m]."""
GREY = (224, 222, 216)
"""Linear tint of concrete decks and walls."""
DIM = (205, 203, 197)
"""The same of their undersides."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RaisedParts:
    """Plan-view areas of all that stands above the ground, and the heights of its edges."""

    open: Area
    """Decks: ground, road or water goes on below."""
    filled: Area
    """Roads between retaining walls."""
    road: EdgeField
    """Heights of the roads' edges."""
    top: EdgeField
    """Heights of the outer edges at their top, sidewalks included."""
    below: Area
    """Everything paved on the ground."""

    @property
    def whole(self) -> Area:
        """Decks and filled parts as one."""
        joined = shapely.union(self.open, self.filled)
        closed = shapely.buffer(joined, 0.05, join_style="mitre", mitre_limit=2.0)
        return areas_only(shapely.buffer(closed, -0.05, join_style="mitre", mitre_limit=2.0), 0.5)


def raised_parts(
    levels: Levels, road: EdgeField | None, junctions: Sequence[tuple[JunctionArea, State]], below: Area
) -> RaisedParts | None:
    """Areas of what stands above the ground; None where nothing does.

    Args:
        levels: What leaves the ground.
        road: Heights of the edges of raised roads.
        junctions: Raised junctions with their state.
        below: Everything paved on the ground.
    """
    if road is None:
        return None
    parts = {state: [levels.area(state)] for state in (State.OPEN, State.FILLED)}
    for junction, state in junctions:
        parts[state] += [junction.roadway, junction.sidewalk]
    opened, filled = (
        areas_only(shapely.union_all(parts[state], grid_size=1e-3)) for state in (State.OPEN, State.FILLED)
    )
    graph = levels.graph
    up = (levels.state == State.OPEN) | (levels.state == State.FILLED)
    lines = [line[a:b] for line in (graph.left_m, graph.right_m) for a, b in runs_in_strips(graph.strip, up)]
    return RaisedParts(
        open=opened,
        filled=areas_only(shapely.difference(filled, opened)),
        road=road,
        top=EdgeField(lines),
        below=below,
    )


class Floor:
    """The floor for walls and piers: the ground, or the bed of a water."""

    def __init__(self, levels: Levels, ground: Terrain) -> None:
        self._waters = levels.waters
        self._ground = ground
        for water in self._waters:
            shapely.prepare(water.area)

    def near_water(self, xy: Array) -> Mask:
        """Whether points (M, 2) lie over or near a water."""
        near = np.zeros(len(xy), dtype=bool)
        for water in self._waters:
            near |= shapely.dwithin(water.area, shapely.points(xy), SHORE_M)
        return near

    def height(self, xy: Array) -> Array:
        """Height [m] at points (M, 2)."""
        z = self._ground.height(xy)
        for water in self._waters:
            inside = shapely.contains_xy(water.area, xy[:, 0], xy[:, 1])
            z = np.where(inside, np.minimum(z, water.level_m - 0.4), z)
        return z


def runs_in_strips(strip: NDArray[np.int64], mask: Mask) -> list[tuple[int, int]]:
    """Half-open ranges of rows that hold a mask, cut where the strip changes."""
    ranges = []
    for number in np.unique(strip[mask]):
        rows = np.flatnonzero(strip == number)
        ranges += [(int(rows[0]) + a, int(rows[0]) + b) for a, b in runs(mask[rows]) if b - a > 1]
    return ranges
