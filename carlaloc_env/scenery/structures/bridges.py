"""Bridges: edges, abutments, undersides and piers of all that carries raised roads."""

import numpy as np
import shapely
from scipy.spatial import cKDTree

from carlaloc_env.core.areas import Area, rings
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.grade_levels import Levels
from carlaloc_env.scenery.ground.height_fields import EdgeField
from carlaloc_env.scenery.ground.raised_parts import DECK_M, DIM, FOOTING_M, Floor, RaisedParts
from carlaloc_env.scenery.ground.terrain import Terrain
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.meshing.triangulation import triangulate
from carlaloc_env.scenery.structures.deck_edges import add_rim, at_end, outward_of
from carlaloc_env.scenery.structures.piers import add_piers

_CELL_M = 5.0


def add_bridges(
    out: MeshBuilder, levels: Levels, parts: RaisedParts, edges_below: EdgeField, ground: Terrain
) -> None:
    """Adds all that carries raised roads.

    Args:
        out: Where it goes.
        levels: What leaves the ground.
        parts: Its areas.
        edges_below: Edges of the roads on the ground, where raised ones end.
        ground: Heights of the ground.
    """
    floor = Floor(levels, ground)
    whole = parts.whole
    ends = cKDTree(edges_below.points_m) if len(edges_below.points_m) else None
    shapely.prepare(parts.open)
    for ring in rings(whole, 1.0):
        add_rim(out, ring, parts, ends, floor)
    rim = shapely.boundary(whole)
    shapely.prepare(rim)
    for ring in rings(parts.open, 1.0):
        _abutments(out, ring, parts, rim, ends, floor)
    xy, triangles = triangulate(parts.open, _CELL_M)
    if len(xy):
        points = np.column_stack([xy, parts.road.nearest(xy)[0] - DECK_M])
        out.triangles(
            points,
            triangles[:, ::-1],
            material=Material.CONCRETE_PANEL,
            tag=Tag.BRIDGE,
            colour=DIM,
        )
    add_piers(out, levels, parts, floor)


def _abutments(
    out: MeshBuilder, ring: Array, parts: RaisedParts, rim: Area, ends: cKDTree | None, floor: Floor
) -> None:
    """Walls at the ends of decks, which look below them."""
    line = ring[:-1]
    middle = 0.5 * (line + np.roll(line, -1, axis=0))
    high = np.column_stack([line, parts.road.nearest(line)[0] - 0.1])
    inner = shapely.distance(rim, shapely.points(middle)) > 0.2
    # Slits between carriageways are no ends: behind an abutment there is ground.
    inner &= shapely.dwithin(parts.filled, shapely.points(middle), 0.3)
    ending = at_end(np.column_stack([middle, parts.top.nearest(middle)[0]]), ends)
    a = np.flatnonzero(inner | ending)
    if not len(a):
        return
    b = np.roll(np.arange(len(line)), -1)[a]
    low = high.copy()
    # A little inside, below the deck, where no road hides the ground.
    low[:, 2] = np.minimum(floor.height(line - 0.6 * outward_of(line)), high[:, 2]) - FOOTING_M
    faces = np.stack([low[b], low[a], high[a], high[b]], axis=1)
    out.quads(faces, material=Material.CONCRETE_PANEL, tag=Tag.BRIDGE, colour=DIM)
