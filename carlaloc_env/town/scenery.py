"""Everything that stands still in a town, built from its map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from carlaloc_env import rng
from carlaloc_env.assets.placing import SignalLenses
from carlaloc_env.materials import Material
from carlaloc_env.scene import Mesh, merge
from carlaloc_env.semantics import Tag
from carlaloc_env.town.areas import TownAreas, town_areas
from carlaloc_env.town.buildings import building_mesh
from carlaloc_env.town.chunks import split_chunks
from carlaloc_env.town.collision import add_plain_lanes, lot_boxes, weld
from carlaloc_env.town.config import TownConfig
from carlaloc_env.town.fields import EdgeField, GroundGrid, JunctionField
from carlaloc_env.town.junctions import add_corners, add_junction_surface, corner_edges
from carlaloc_env.town.lots import Lot, place_lots
from carlaloc_env.town.markings import add_markings
from carlaloc_env.town.meshing import MeshBuilder
from carlaloc_env.town.network import LaneNetwork
from carlaloc_env.town.pavements import add_pavements
from carlaloc_env.town.roads import add_roads
from carlaloc_env.town.sections import Strip, road_strips
from carlaloc_env.town.terrain import MARGIN_M, Ground, add_terrain, zone_areas

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scenery:
    """The standing part of a town."""

    chunks: tuple[Mesh, ...]
    """All that is seen, in squares."""
    collision_vertices_m: Array
    """Corners of all that is solid [m], shape (V, 3)."""
    collision_triangles: NDArray[np.int32]
    """Corner indices, shape (T, 3)."""
    lenses: SignalLenses
    """Lenses of the traffic lights."""
    lamps_m: Array
    """Light sources of the street lamps [m], shape (K, 3)."""


def build_scenery(network: LaneNetwork, config: TownConfig, seed: int) -> Scenery:
    """Scenery of a map; the same map, configuration and seed give the same bytes."""
    roads = network.xodr.roads
    strips = road_strips(roads, network.surface)
    areas = town_areas(strips, roads)
    bounds = shapely.box(*shapely.bounds(shapely.buffer(areas.roadway, MARGIN_M)))
    zones = zone_areas(config, bounds)

    lanes, raised, solid = MeshBuilder(), MeshBuilder(), MeshBuilder()
    add_roads(lanes, strips, seed)
    add_plain_lanes(solid, strips)
    add_pavements(raised, strips, seed)
    kerb_field = EdgeField(_road_edges(strips))
    for junction in areas.junctions:
        add_junction_surface(raised, junction, JunctionField(junction.strips, network.surface), seed)
        add_corners(raised, junction, areas, kerb_field)
    ground = _ground(strips, areas, kerb_field, bounds)
    add_terrain(raised, bounds, areas.paved, zones, ground)
    paint = MeshBuilder()
    add_markings(paint, strips, roads)

    lots = place_lots(strips, areas.paved, zones, seed)
    bases = _base_heights(lots, ground)
    buildings = _buildings(lots, bases, seed)
    solid.quads(lot_boxes(lots, bases), material=Material.PLAIN, tag=Tag.BUILDING)

    floor = raised.build()
    vertices, triangles = weld([solid.build(), floor])
    return Scenery(
        chunks=split_chunks(merge([lanes.build(), floor, paint.build(), *buildings])),
        collision_vertices_m=vertices,
        collision_triangles=triangles,
        lenses=SignalLenses(
            signal=np.zeros(0, np.int32), state=np.zeros(0, np.uint8), T_world_lens=np.zeros((0, 4, 4))
        ),
        lamps_m=np.zeros((0, 3)),
    )


def _road_edges(strips: Sequence[Strip]) -> list[Array]:
    """Edges of everything at road level, from which kerbs take their height."""
    lines = []
    for strip in strips:
        for lane in range(len(strip.lanes)):
            if strip.kind(lane) == "roadway":
                lines += list(strip.lane_edges(lane))
    return lines


def _ground(strips: Sequence[Strip], areas: TownAreas, kerb_field: EdgeField, bounds: object) -> Ground:
    lines = []
    for strip in strips:
        span = strip.span(("roadway", "walkway", "median"))
        if span is not None and strip.junction_id is None:
            lines += [strip.lane_edges(span[0])[0], strip.lane_edges(span[1] - 1)[1]]
    for junction in areas.junctions:
        lines += corner_edges(junction, kerb_field)
    outer = EdgeField(lines + _junction_rims(strips), 0.5)
    x0, y0, x1, y1 = shapely.bounds(bounds)
    grid = GroundGrid(outer.points_m, np.array([x0, y0]), np.array([x1, y1]))
    return Ground(edge=outer, grid=grid)


def _junction_rims(strips: Sequence[Strip]) -> list[Array]:
    """Outer edges of connecting roads, for junctions without pavements."""
    lines = []
    for strip in strips:
        span = strip.span(("roadway",))
        if span is not None and strip.junction_id is not None:
            lines += [strip.edges_m[span[0]], strip.edges_m[span[1]]]
    return lines


def _base_heights(lots: Sequence[Lot], ground: Ground) -> list[float]:
    """Height of each building's floor: the mean of the ground along its front."""
    bases = []
    for lot in lots:
        along = np.array([np.cos(lot.heading_rad), np.sin(lot.heading_rad)])
        points = lot.corner_m + np.linspace(0.0, lot.plan.width_m, 5)[:, None] * along
        bases.append(float(ground.height(points).mean()))
    return bases


def _buildings(lots: Sequence[Lot], bases: Sequence[float], seed: int) -> list[Mesh]:
    meshes = []
    for number, (lot, base) in enumerate(zip(lots, bases, strict=True)):
        T = np.eye(4)
        c, s = np.cos(lot.heading_rad), np.sin(lot.heading_rad)
        T[:2, :2] = [[c, -s], [s, c]]
        T[:3, 3] = (*lot.corner_m, base)
        mesh = building_mesh(lot.plan, rng.stream(seed, lot.name, index=1), instance=number + 1)
        meshes.append(mesh.transformed(T))
    return meshes
