"""Things that stand about in a town: lights and signs, furniture, roadside, plants and single features."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import cKDTree

from carlaloc_env.assets.trees import FORMS
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material, SignalLenses, Tag
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.town.config import TownConfig
from carlaloc_env.town.ground.ground_plan import Groundwork
from carlaloc_env.town.ground.land_raster import Land, Raster
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.town.meshing.collision_mesh import posts
from carlaloc_env.town.meshing.instance_ids import InstanceIds
from carlaloc_env.town.meshing.mesh_builder import MeshBuilder
from carlaloc_env.town.meshing.polygons import polygons_of
from carlaloc_env.town.roads.surfaces import Surfaces
from carlaloc_env.town.street.landmarks import feature_lamps, feature_mesh, roofed_sites
from carlaloc_env.town.street.roadside import Roadside, line_roads
from carlaloc_env.town.street.signals_and_signs import add_signals, add_signs
from carlaloc_env.town.street.site_plan import Plots
from carlaloc_env.town.street.street_furniture import Furnisher
from carlaloc_env.town.street.street_props import Placement
from carlaloc_env.town.vegetation.land_cover import dress_land, is_tree

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
    green = dress_land(out.raised, cover, out.solid, _land(work, plots, roadside, route_m, seed), plots.lots)
    paved, floor = work.areas.paved, work.floor_height
    features = [feature_mesh(site, paved, floor, seed, ids.take()) for site in plots.features]
    for feature in features:
        out.solid.add(feature)
    props = [*furnisher.meshes(ids), *green.meshes(ids)]
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
