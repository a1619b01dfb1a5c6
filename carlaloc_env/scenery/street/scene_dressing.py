"""Things that stand about in a town: lights and signs, furniture, roadside, plants and single features.

Things beside roads rather than on sidewalks: rails, masts, wires, parked cars, car parks.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import cKDTree

from carlaloc_env.assets.posts_and_fences import delineator
from carlaloc_env.assets.tree_forms import FORMS
from carlaloc_env.core.areas import (
    Area,
    areas_only,
    polygons_of,
    without,
)
from carlaloc_env.core.array_types import Array
from carlaloc_env.map.config import RoadsideConfig, TownConfig
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scene.signal_lenses import SignalLenses
from carlaloc_env.scenery.ground.ground_plan import Groundwork
from carlaloc_env.scenery.ground.terrain import Land, Raster
from carlaloc_env.scenery.mapped import of_kind
from carlaloc_env.scenery.meshing.batches import InstanceIds, PropField, copies, poses
from carlaloc_env.scenery.meshing.collision_mesh import posts
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.roads.surfaces import Surfaces
from carlaloc_env.scenery.street.car_parks import add_car_park
from carlaloc_env.scenery.street.mapped_scenery import add_grounds, put_plants
from carlaloc_env.scenery.street.parked_cars import ParkedCars, lay_drives, park_in_lanes, park_on_verges
from carlaloc_env.scenery.street.signals_and_signs import add_signals, add_signs
from carlaloc_env.scenery.street.site_plan import (
    Plots,
    feature_lamps,
    feature_mesh,
    roofed_sites,
    spanning_sites,
)
from carlaloc_env.scenery.street.street_furniture import Furnisher, Placement
from carlaloc_env.scenery.street.street_greenery import add_street_greenery
from carlaloc_env.scenery.structures.exit_signs import add_exit_signs
from carlaloc_env.scenery.structures.guard_rails import (
    add_guard_rails,
    add_medians,
    add_wire_fences,
    delineator_feet,
)
from carlaloc_env.scenery.structures.masts import POLE_M, add_lines, corridor, mast_meshes, place_lines
from carlaloc_env.scenery.vegetation.gardens import dress_land, is_tree

SIGN_CLEAR_M = 2.6
"""Nothing else stands nearer to the foot of a direction sign [m]."""
GREENS = ("green", "wood", "field", "residential")
"""Mapped areas on which plants are added."""
FOOT_CLEAR_M, CROSSWALK_CLEAR_M = 0.6, 4.0
"""The same of masts, posts and poles, and of crosswalks beside which no car stands on a verge [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Roadside:
    """Everything that was placed."""

    meshes: list[Mesh]
    """Everything that is seen."""
    lamps_m: Array
    """Lights of the masts [m], shape (K, 3)."""
    taken: Area
    """Ground on which nothing else may grow or stand."""


class _Occupied:
    """Ground on which nothing else may stand; it grows while things are placed."""

    def __init__(self, *areas: Area) -> None:
        self.area: Area = shapely.union_all(areas)

    def add(self, *areas: Area) -> None:
        """Occupy more ground."""
        self.area = shapely.union_all([self.area, *areas])


def line_roads(
    solid: MeshBuilder,
    network: LaneNetwork,
    work: Groundwork,
    plots: Plots,
    config: RoadsideConfig,
    ids: InstanceIds,
) -> Roadside:
    """Line all roads; solid things also go to `solid`."""
    fittings, cars, ways = MeshBuilder(), ParkedCars(), plots.waysides
    paved, spans = work.areas.paved, spanning_sites(plots.features)
    reserved = shapely.union_all([plots.reserved, *plots.footprints()])
    rails = add_guard_rails(fittings, solid, ways, paved)
    medians = add_medians(fittings, solid, work.strips, work.roads)
    for park in plots.car_parks:
        add_car_park(fittings, cars, park, ways, ids.take())
    masts, lights, feet = mast_meshes(ways, medians, paved, spans, work.overhead, ids)
    markers, yaws = np.zeros((0, 3)), np.zeros(0)
    if config.delineators:
        markers, yaws = delineator_feet(ways, shapely.union(paved, reserved))
    if len(markers):
        masts.append(copies(delineator(), poses(markers, yaws), ids.take(len(markers))))
    signs, sign_feet = PropField(), np.zeros((0, 3))
    if config.exit_signs:
        built = _Occupied(*(site.ground for site in plots.features), *plots.footprints())
        built.add(spans, *_discs(feet))
        sign_feet = add_exit_signs(signs, network, paved, built.area, work.overhead, ways.ground.height)
    masts += signs.meshes(ids)
    taken = _Occupied(reserved, paved, rails, *_discs(feet))
    taken.add(*_discs(markers), *_discs(sign_feet, SIGN_CLEAR_M))
    rows = place_lines(ways, taken.area, work.overhead)
    poles, pole_feet = add_lines(fittings, rows, ids)
    taken.add(*_discs(pole_feet))
    walks = shapely.union_all([shapely.Polygon(walk.polygon_m[:, :2]) for walk in network.crosswalks])
    park_in_lanes(cars, work.strips, ways, walks)
    drives = lay_drives(fittings, cars, ways, taken.area)
    taken.add(shapely.buffer(walks, CROSSWALK_CLEAR_M))
    taken.add(*drives)
    park_on_verges(cars, ways, taken.area)
    taken.add(*cars.footprints())
    fenced = add_wire_fences(fittings, solid, ways, taken.area)
    cars.add_boxes(solid)
    for places, radius, height in ((feet, 0.11, 8.0), (pole_feet, 0.15, POLE_M), (sign_feet, 0.3, 3.0)):
        solid.quads(posts(places, radius, height), material=Material.PLAIN, tag=Tag.POLE)
    parks = [park.area() for park in plots.car_parks]
    grounds = [rails, fenced, corridor(rows), *drives, *cars.footprints(), *parks]
    discs = [*_discs(feet), *_discs(markers), *_discs(sign_feet, SIGN_CLEAR_M)]
    return Roadside(
        meshes=[fittings.build(), *masts, *poles, *cars.meshes(ids)],
        lamps_m=lights,
        taken=shapely.union_all([*grounds, *discs]),
    )


def _discs(feet: Array, radius_m: float = FOOT_CLEAR_M) -> list[Area]:
    return list(shapely.buffer(shapely.points(feet[:, :2]), radius_m)) if len(feet) else []


SOLID_PROPS = (
    ("bus_shelter", 0.8, 2.4),
    ("column", 0.65, 3.2),
    ("hydrant", 0.15, 0.7),
    ("planter", 0.5, 0.5),
)
"""Further props that a car can hit: name, radius and height of their prism [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Dressing:
    """Everything that was placed."""

    meshes: list[Mesh]
    """Everything that is seen, except the ground cover."""
    cover: Mesh
    """Crops, grass and bushes."""
    lenses: SignalLenses
    """Lenses of the traffic lights."""
    lamps_m: Array
    """Light sources of lamps [m], shape (K, 3)."""


def dress(
    out: Surfaces,
    network: LaneNetwork,
    work: Groundwork,
    plots: Plots,
    config: TownConfig,
    route_m: Array | None,
    seed: int,
    ids: InstanceIds,
) -> Dressing:
    """Place everything; solid things also go to `out`."""
    lights, lenses, light_feet = add_signals(network, work.floor_height, ids)
    signs, sign_feet = add_signs(network, work.floor_height, ids)
    roadside = line_roads(out.solid, network, work, plots, config.roadside, ids)
    clear = [light_feet[:, :2], sign_feet[:, :2], *(walk.polygon_m[:, :2] for walk in network.crosswalks)]
    furnisher = _furnish(work, plots, roadside, np.concatenate(clear), route_m, seed)
    cover = MeshBuilder()
    land = _land(work, plots, roadside, route_m, seed)
    green = dress_land(out.raised, cover, out.solid, land, plots.lots)
    if plots.mapped is not None:
        solid = areas_only(shapely.union_all([work.areas.paved, *plots.footprints()]))
        add_grounds(out.raised, plots.mapped, solid, work.ground)
        kept = areas_only(shapely.union_all([work.areas.roadway, *plots.footprints()]))
        put_plants(green, plots.mapped, land, kept)
    paved, floor = work.areas.paved, work.floor_height
    features = [feature_mesh(site, paved, floor, seed, ids.take()) for site in plots.features]
    for feature in features:
        out.solid.add(feature)
    props = [*furnisher.meshes(ids), *green.meshes(ids)]
    street_green = PropField()
    feet = [foot for feet in furnisher.placed.feet.values() for foot in feet]
    posts_m = np.concatenate([np.array(feet, np.float64).reshape(-1, 3)[:, :2], *clear])
    add_street_greenery(street_green, land, plots.lots, posts_m)
    # After all else, so that nothing else changes its id.
    props += street_green.meshes(ids)
    _add_posts(out.solid, furnisher.placed, light_feet, green.feet_m(is_tree))
    lamps = [furnisher.lamps_m(), roadside.lamps_m, feature_lamps(plots.features, paved, floor)]
    return Dressing(
        meshes=[*lights, *signs, *features, *roadside.meshes, *props],
        cover=cover.build(),
        lenses=lenses,
        lamps_m=np.concatenate(lamps),
    )


def _furnish(
    work: Groundwork, plots: Plots, roadside: Roadside, clear_m: Array, route_m: Array | None, seed: int
) -> Furnisher:
    """Furniture of all sidewalks."""
    covers = [stretch.area(stretch.detached) for stretch in work.levels.stretches]
    roofed = shapely.union_all([work.overhead, *covers, roofed_sites(plots.features)])
    kept_free = [*plots.footprints(), *polygons_of(roadside.taken), *polygons_of(work.overhead)]
    furnisher = Furnisher(work.zones, clear_m, route_m, kept_free, roofed, seed)
    for strip in work.strips:
        if strip.junction_id is None:
            furnisher.sidewalk(strip)
    return furnisher


def _land(work: Groundwork, plots: Plots, roadside: Roadside, route_m: Array | None, seed: int) -> Land:
    waters = [area for kind, area in work.zones if kind == "water"]
    taken = [work.areas.paved, plots.reserved, roadside.taken, *plots.footprints(), *waters]
    if plots.mapped is not None:
        # Plants are added to greens and gardens that are mapped, and nowhere else.
        greens = [feature.shape for feature in of_kind(plots.mapped, *GREENS)]
        taken.append(without(work.bounds, areas_only(shapely.union_all(greens))))
    return Land(
        bounds=work.bounds,
        zones=work.zones,
        ground=work.ground,
        strips=work.strips,
        roads=Raster(work.bounds, [work.areas.paved]),
        taken=Raster(work.bounds, taken),
        route=None if route_m is None or not len(route_m) else cKDTree(route_m),
        seed=seed,
    )


def _add_posts(solid: MeshBuilder, placed: Placement, light_feet: Array, trunks: Array) -> None:
    """Lamps, trunks, traffic lights and shelters as prisms that a car can hit."""
    groups = [(placed.feet_of("lamp"), 0.11, 8.0), (light_feet, 0.14, 6.0), (trunks, 0.17, 3.0)]
    groups += [(placed.feet_of(f"tree {kind}"), 0.17, 3.0) for kind in FORMS]
    groups += [(placed.feet_of(name), r, h) for name, r, h in SOLID_PROPS]
    for feet, radius, height in groups:
        solid.quads(posts(feet, radius, height), material=Material.PLAIN, tag=Tag.POLE)
