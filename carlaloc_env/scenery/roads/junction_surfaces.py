"""Surfaces of junctions: one for all connecting roads, and the sidewalks round their corners."""

import numpy as np
import shapely

from carlaloc_env.core import clock
from carlaloc_env.core.areas import Area, areas_only, polygons_of, rings
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.height_fields import EdgeField, JunctionField
from carlaloc_env.scenery.ground.lane_strips import KERB_M
from carlaloc_env.scenery.ground.paved_areas import JunctionArea, TownAreas
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.meshing.triangulation import triangulate
from carlaloc_env.scenery.roads.fast_roads import FAST_SURFACE
from carlaloc_env.scenery.roads.lane_surfaces import LOOSE
from carlaloc_env.scenery.roads.sidewalks import BELOW_M, KERB_STONE_M

SURFACE_CELL_M = 1.5
"""Side of the triangles of a junction's surface [m]."""
CORNER_CELL_M = 3.0
"""Side of the triangles of its sidewalks [m]."""
GRASS_ISLAND_M2 = 25.0
"""Islands larger than this carry grass [m²]."""


def add_junction_surface(
    out: MeshBuilder, junction: JunctionArea, field: JunctionField, seed: int, *, fast: bool
) -> None:
    """Asphalt of one junction, darker where many turn; `fast` where only fast roads meet."""
    xy, triangles = triangulate(junction.roadway, SURFACE_CELL_M)
    if not len(xy):
        return
    draw = clock.stream(seed, f"junction/{junction.id}")
    material, tint = FAST_SURFACE if fast else Material.ASPHALT, np.full(3, 255.0)
    loose = unpaved_junction(junction)
    if loose:
        material, tint = LOOSE[loose][0], np.array(LOOSE[loose][1])
    points = np.column_stack([xy, field.height(xy)])
    shade = draw.uniform(205, 240) * (0.9 + 0.1 * _quiet(junction, xy))
    out.triangles(
        points,
        triangles,
        material=material,
        tag=Tag.ROAD,
        colour=shade[:, None] / 255.0 * tint,
    )


def unpaved_junction(junction: JunctionArea) -> str:
    """Surface of a junction where no asphalt lies on any of its driving lanes; else empty."""
    kinds = {
        strip.unpaved(lane)
        for strip in junction.strips
        for lane in range(len(strip.lanes))
        if strip.lanes[lane].type == "driving"
    }
    return kinds.pop() if len(kinds) == 1 else ""


def add_corners(out: MeshBuilder, junction: JunctionArea, areas: TownAreas, edge: EdgeField) -> None:
    """Raised sidewalks of one junction with their kerbs and outer edges."""
    if not junction.sidewalk.is_empty:
        _raise(out, junction.sidewalk, areas.roadway, edge, junction.kerb_m, Material.PAVEMENT)


def add_islands(out: MeshBuilder, areas: TownAreas, edge: EdgeField) -> None:
    """Grass on a ring of kerb stones wherever carriageways enclose a piece of ground."""
    for island in polygons_of(areas.islands):
        material = Material.GRASS if island.area > GRASS_ISLAND_M2 else Material.PAVEMENT
        _raise(out, island, areas.roadway, edge, KERB_M, material)


def _raise(
    out: MeshBuilder, area: Area, roadway: Area, edge: EdgeField, kerb_m: float, top: Material
) -> None:
    # Only roads close by matter; cutting first keeps the polygon work small.
    window = shapely.box(*shapely.bounds(shapely.buffer(area, 1.0)))
    near = shapely.intersection(roadway, window)
    beside = shapely.buffer(near, KERB_STONE_M)
    grass = top == Material.GRASS

    def height(xy: Array) -> Array:
        return edge.nearest(xy)[0]

    for part, material, tag, colour in (
        (shapely.difference(area, beside), top, Tag.TERRAIN if grass else Tag.SIDEWALK, (232, 230, 226)),
        (shapely.intersection(area, beside), Material.KERB, Tag.SIDEWALK, (225, 225, 222)),
    ):
        ground = areas_only(part)
        out.sheet(ground, CORNER_CELL_M, height, lift_m=kerb_m, material=material, tag=tag, colour=colour)
    _rims(out, area, kerb_m, near, edge)


def _rims(out: MeshBuilder, area: Area, kerb_m: float, roadway: Area, edge: EdgeField) -> None:
    shapely.prepare(roadway)
    for ring in rings(area, 1.0):
        top = np.column_stack([ring, edge.nearest(ring)[0] + kerb_m])
        middle = 0.5 * (ring[1:] + ring[:-1])
        kerb = shapely.dwithin(roadway, shapely.points(middle), 0.05)
        drop = kerb_m + BELOW_M + np.where(kerb, 0.0, 0.25)
        down = np.zeros((len(middle), 3))
        down[:, 2] = drop
        quads = np.stack([top[:-1] - down, top[1:] - down, top[1:], top[:-1]], axis=1)
        material = np.where(kerb, Material.KERB, Material.CONCRETE)
        out.quads(quads, material=material, tag=Tag.SIDEWALK, colour=(215, 215, 212))


def _quiet(junction: JunctionArea, xy: Array) -> Array:
    """1 where no wheel passes, 0 on wheel tracks of the connecting lanes, shape (M,)."""
    lines = []
    for strip in junction.strips:
        for lane in range(len(strip.lanes)):
            if strip.kind(lane) == "roadway" and strip.lanes[lane].type != "shoulder":
                left, right = strip.lane_edges(lane)
                lines += [left + (right - left) * share for share in (0.23, 0.77)]
    _, distance = EdgeField(lines, 0.5).nearest(xy)
    result: Array = np.clip(distance / 0.5, 0.0, 1.0)
    return result
