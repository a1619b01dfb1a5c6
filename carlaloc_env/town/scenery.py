"""Everything that stands still in a town, built from its map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from carlaloc_env import rng
from carlaloc_env.assets.placing import SignalLenses
from carlaloc_env.assets.trees import FORMS
from carlaloc_env.materials import Material
from carlaloc_env.scene import Mesh, merge
from carlaloc_env.semantics import Tag
from carlaloc_env.town.areas import TownAreas, town_areas
from carlaloc_env.town.bridges import add_bridges, raised_parts
from carlaloc_env.town.buildings import building_mesh
from carlaloc_env.town.car_parks import place_car_parks
from carlaloc_env.town.chunks import FAR_CHUNK_M, split_chunks
from carlaloc_env.town.collision import add_plain_lanes, lot_boxes, posts, weld
from carlaloc_env.town.config import TownConfig
from carlaloc_env.town.features import feature_car_parks, feature_mesh, sites
from carlaloc_env.town.fields import EdgeField, GroundGrid, JunctionField
from carlaloc_env.town.furniture import Furnisher
from carlaloc_env.town.junction_details import add_junction_details
from carlaloc_env.town.junctions import add_corners, add_islands, add_junction_surface, corner_edges
from carlaloc_env.town.land import Land, Raster
from carlaloc_env.town.level_graph import grown
from carlaloc_env.town.levels import WALL_M, Levels, State, find_levels, level_fields
from carlaloc_env.town.lots import Lot, place_lots
from carlaloc_env.town.markings import add_markings
from carlaloc_env.town.meshing import MeshBuilder
from carlaloc_env.town.network import LaneNetwork
from carlaloc_env.town.painted import RoadPainter
from carlaloc_env.town.pavements import add_pavements
from carlaloc_env.town.polygons import Area, areas_only, polygons_of
from carlaloc_env.town.road_details import add_road_details
from carlaloc_env.town.road_edges import road_edges
from carlaloc_env.town.roads import add_roads
from carlaloc_env.town.roadside import RoadsideSite, line_roads
from carlaloc_env.town.sections import KERB_M, Strip, road_strips
from carlaloc_env.town.signposts import add_signals, add_signs
from carlaloc_env.town.skyline import add_skyline
from carlaloc_env.town.street_props import Placement
from carlaloc_env.town.structures import add_underpasses
from carlaloc_env.town.surroundings import dress_land, is_tree
from carlaloc_env.town.terrain import BANK_SLOPE, MARGIN_M, Ground, add_terrain, zone_areas
from carlaloc_env.town.water import add_water, bank_tops, shores

Array = NDArray[np.float64]

OVERHEAD_CLEAR_M = 2.5
"""Distance of buildings and trees from raised roads [m]."""
PROMENADE_M = 3.7
"""Quays this near to something paved have a railing of their own [m]."""
SOLID_PROPS = (
    ("bus_shelter", 0.8, 2.4),
    ("column", 0.65, 3.2),
    ("hydrant", 0.15, 0.7),
    ("planter", 0.5, 0.5),
)
"""Further props that a car can hit: name, radius and height of their prism [m]."""


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


def build_scenery(
    network: LaneNetwork, config: TownConfig, seed: int, route_m: Array | None = None
) -> Scenery:
    """Scenery of a map; the same map, configuration and seed give the same bytes."""
    roads = network.xodr.roads
    strips = road_strips(roads, network.surface)
    bounds = _bounds(strips)
    zones = zone_areas(config, bounds)
    corners = np.array(shapely.bounds(bounds)).reshape(2, 2)
    box = (corners[0], corners[1])
    levels = find_levels(strips, *box, zones)
    carried = _carried_junctions(levels, strips)
    areas = town_areas(strips, roads, levels.overhead(), frozenset(carried))

    lanes, raised, solid = MeshBuilder(), MeshBuilder(), MeshBuilder()
    add_roads(lanes, strips, seed)
    add_plain_lanes(solid, strips)
    add_road_details(lanes, strips, roads, seed)
    add_pavements(raised, strips, roads, seed)
    kerb_field, deck_field = level_fields(strips, levels, [_road_edges(strip) for strip in strips])
    for junction in areas.junctions:
        field = deck_field if junction.id in carried and deck_field is not None else kerb_field
        surface = JunctionField(junction.strips, network.surface)
        add_junction_surface(raised, junction, surface, seed)
        add_junction_details(lanes, junction, surface, seed)
        add_corners(raised, junction, areas, field)
    add_islands(raised, areas, kerb_field)
    shore = shores(levels.waters, zones, areas.low_paved)
    ground = _ground(areas, kerb_field, levels, bank_tops(shore), box)
    seas = _seas(config, levels)
    add_terrain(raised, bounds, _ground_paving(levels, areas), zones, ground, seas)
    tunnel_lamps = add_underpasses(raised, levels)
    decks = raised_parts(
        levels, deck_field, [(j, carried[j.id]) for j in areas.junctions if j.id in carried], areas.low_paved
    )
    if decks is not None:
        add_bridges(raised, levels, decks, kerb_field, ground)
    overhead = shapely.Polygon() if decks is None else decks.whole
    promenades = shapely.union_all([area for kind, area in zones if kind == "waterfront"])
    lined = shapely.difference(shapely.buffer(promenades, 1.5), shapely.buffer(areas.paved, PROMENADE_M))
    add_water(raised, levels.waters, shore, ground, shapely.buffer(overhead, 0.8), lined)
    paint = MeshBuilder()
    add_markings(paint, strips, roads)
    RoadPainter(network, strips, areas).add_all(paint)

    taken = sites(config.features)
    cuts = _cuts(levels, overhead)
    reserved = shapely.union_all([cuts, *(site.ground for site in taken)])
    edges = road_edges(strips, roads, levels)
    parks = feature_car_parks(config.features)
    parks += place_car_parks(edges, zones, shapely.union(areas.paved, reserved), ground, seed)
    reserved = shapely.union_all([reserved, *(park.area() for park in parks)])
    lots = place_lots(strips, shapely.union(areas.paved, reserved), zones, seed)
    bases = _base_heights(lots, ground)
    buildings = _buildings(lots, bases, seed)
    solid.quads(lot_boxes(lots, bases), material=Material.PLAIN, tag=Tag.BUILDING)

    floor = Floor(raised=areas.raised, kerb=kerb_field, ground=ground)
    number = len(lots) + 1
    lights, lenses, light_feet = add_signals(network, floor.height, number)
    signs, sign_feet = add_signs(network, floor.height, number + len(lights))
    clear = [light_feet[:, :2], sign_feet[:, :2], *(walk.polygon_m[:, :2] for walk in network.crosswalks)]
    footprints = [lot.footprint() for lot in lots]
    roofed = shapely.union_all([overhead, *(s.area(s.detached) for s in levels.stretches)])
    number += len(lights) + len(signs)
    beside = RoadsideSite(
        strips=strips,
        roads=roads,
        edges=edges,
        areas=areas,
        zones=zones,
        crosswalks=network.crosswalks,
        ground=ground,
        blocked=shapely.union_all([reserved, *footprints]),
        overhead=overhead,
        car_parks=parks,
        seed=seed,
    )
    roadside = line_roads(solid, beside, number)
    number += roadside.instances
    kept_free = [*footprints, *polygons_of(roadside.taken), *polygons_of(overhead)]
    furnisher = Furnisher(zones, np.concatenate(clear), route_m, kept_free, roofed, seed)
    for strip in strips:
        if strip.junction_id is None:
            furnisher.pavement(strip)
    land = Land(
        bounds=bounds,
        zones=zones,
        ground=ground,
        strips=strips,
        roads=Raster(bounds, [areas.paved]),
        taken=Raster(
            bounds,
            [areas.paved, reserved, roadside.taken, *footprints, *(z for k, z in zones if k == "water")],
        ),
        route=None if route_m is None or not len(route_m) else cKDTree(route_m),
        seed=seed,
    )
    cover = MeshBuilder()
    green = dress_land(raised, cover, solid, land, lots)
    features = [
        feature_mesh(site, areas.paved, floor.height, seed, number + k) for k, site in enumerate(taken)
    ]
    for feature in features:
        solid.add(feature)
    props = furnisher.meshes(number + len(features))
    number += len(features) + furnisher.count
    props += green.meshes(number)
    number += green.count
    far = add_skyline(bounds, zones, ground, seed, number, shapely.union_all([sea for sea, _ in seas]))
    _add_posts(solid, furnisher.placed, light_feet, green.feet_m(is_tree))

    firm = raised.build()
    vertices, triangles = weld([solid.build(), firm])
    parts = [
        lanes.build(),
        firm,
        cover.build(),
        paint.build(),
        *buildings,
        *lights,
        *signs,
        *features,
        *roadside.meshes,
        *props,
    ]
    return Scenery(
        chunks=split_chunks(merge(parts)) + split_chunks(merge(far), FAR_CHUNK_M),
        collision_vertices_m=vertices,
        collision_triangles=triangles,
        lenses=lenses,
        lamps_m=np.concatenate([furnisher.lamps_m(), roadside.lamps_m, tunnel_lamps]),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Floor:
    """Height of what one would stand on."""

    raised: Area
    """Pavements and medians."""
    kerb: EdgeField
    """Heights of the roads' edges."""
    ground: Ground
    """Heights elsewhere."""

    def height(self, xy_m: Array) -> Array:
        """Height [m] at points (M, 2)."""
        on = shapely.intersects_xy(self.raised, xy_m[:, 0], xy_m[:, 1])
        return np.where(on, self.kerb.nearest(xy_m)[0] + KERB_M, self.ground.height(xy_m))


def _cuts(levels: Levels, overhead: Area) -> Area:
    """Sunken and raised stretches with room for their walls, embankments and waters."""
    parts = [s.area(np.ones(len(s.left_m), bool), 1.0) for s in levels.stretches]
    parts += [water.area for water in levels.waters]
    parts.append(shapely.buffer(overhead, OVERHEAD_CLEAR_M))
    banks = levels.area(State.BANK)
    if not banks.is_empty:
        high = levels.lift_m[levels.state == State.BANK].max()
        parts.append(shapely.buffer(banks, BANK_SLOPE * high + 1.0))
    return shapely.union_all(parts)


def _ground_paving(levels: Levels, areas: TownAreas) -> Area:
    """What the terrain leaves free: all paving on the ground, open cuts, filled stretches and waters."""
    result = shapely.union(
        areas.low_paved, shapely.union(levels.area(State.FILLED, State.BANK), levels.landings())
    )
    for stretch in levels.stretches:
        result = shapely.difference(result, stretch.area(stretch.detached))
        result = shapely.union(result, stretch.area(grown(~stretch.detached), WALL_M))
    return areas_only(shapely.union_all([result, levels.upper, *(water.area for water in levels.waters)]))


def _seas(config: TownConfig, levels: Levels) -> list[tuple[Area, float]]:
    """Waters as wide as `town.toml` draws them, beyond the town's near ground, with their levels [m]."""
    found = []
    for zone in config.zones:
        whole = shapely.make_valid(shapely.Polygon(zone.polygon))
        near = [water.level_m for water in levels.waters if shapely.intersects(water.area, whole)]
        if zone.kind == "water" and near:
            found.append((whole, min(near)))
    return found


def _carried_junctions(levels: Levels, strips: Sequence[Strip]) -> dict[str, State]:
    """Junctions that stand above the ground, with their state."""
    found: dict[str, State] = {}
    for number, strip in enumerate(strips):
        state = levels.state[levels.graph.rows(number)]
        if strip.junction_id is None or not len(state) or (state != state[0]).any():
            continue
        if state[0] in (State.OPEN, State.FILLED):
            found[strip.junction_id] = State(int(state[0]))
    return found


def _bounds(strips: Sequence[Strip]) -> Area:
    """The town's near ground: a box round all roads."""
    lines = np.concatenate([line[:, :2] for strip in strips for line in _road_edges(strip)])
    low, high = lines.min(axis=0) - MARGIN_M, lines.max(axis=0) + MARGIN_M
    return shapely.box(*low, *high)


def _add_posts(solid: MeshBuilder, placed: Placement, light_feet: Array, trunks: Array) -> None:
    """Lamps, trunks, traffic lights and shelters as prisms that a car can hit."""
    groups = [(placed.feet_of("lamp"), 0.11, 8.0), (light_feet, 0.14, 6.0), (trunks, 0.17, 3.0)]
    groups += [(placed.feet_of(f"tree {kind}"), 0.17, 3.0) for kind in FORMS]
    groups += [(placed.feet_of(name), r, h) for name, r, h in SOLID_PROPS]
    for feet, radius, height in groups:
        if len(feet):
            faces = posts(feet, np.full(len(feet), radius), np.full(len(feet), height))
            solid.quads(faces, material=Material.PLAIN, tag=Tag.POLE)


def _road_edges(strip: Strip) -> list[Array]:
    """Edges of a strip's lanes at road level, from which kerbs take their height."""
    return [
        line
        for lane in range(len(strip.lanes))
        if strip.kind(lane) == "roadway"
        for line in strip.lane_edges(lane)
    ]


def _ground(
    areas: TownAreas, kerb_field: EdgeField, levels: Levels, shore: Sequence[Array], box: tuple[Array, Array]
) -> Ground:
    """Heights of the ground: along everything paved that lies on it, along cuts and shores, and between."""
    count = len(levels.graph.prints)
    lines = [line for strip in range(count) for line in levels.ground_lines(strip)]
    banks = [line for strip in range(count) for line in levels.bank_lines(strip)]
    for stretch in levels.stretches:
        lines += [stretch.left_top_m, stretch.right_top_m]
    for junction in areas.junctions:
        if junction.id not in areas.carried:
            lines += corner_edges(junction, kerb_field)
    outer = EdgeField([*lines, *shore], 0.5)
    bank = EdgeField(banks, 0.5) if banks else None
    return Ground(edge=outer, grid=GroundGrid(outer.points_m, *box), bank=bank)


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
