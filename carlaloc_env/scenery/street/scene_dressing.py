"""Things that stand about in a town: lights and signs, furniture, roadside, plants and single features."""

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import cKDTree

from carlaloc_env.assets.tree_forms import FORMS
from carlaloc_env.core.areas import (
    areas_only,
    polygons_of,
    without,
)
from carlaloc_env.core.array_types import Array
from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scene.signal_lenses import SignalLenses
from carlaloc_env.scenery.ground.ground_plan import Groundwork
from carlaloc_env.scenery.ground.land import Land, Raster
from carlaloc_env.scenery.mapped import of_kind
from carlaloc_env.scenery.meshing.collision_mesh import posts
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.meshing.props import InstanceIds, PropField
from carlaloc_env.scenery.roads.surfaces import Surfaces
from carlaloc_env.scenery.street.features import feature_lamps, feature_mesh, roofed_sites
from carlaloc_env.scenery.street.mapped_scenery import add_grounds, put_plants
from carlaloc_env.scenery.street.roadside import Roadside, line_roads
from carlaloc_env.scenery.street.sidewalk_props import Placement
from carlaloc_env.scenery.street.signals_and_signs import add_signals, add_signs
from carlaloc_env.scenery.street.site_plan import Plots
from carlaloc_env.scenery.street.street_furniture import Furnisher
from carlaloc_env.scenery.street.street_greenery import add_street_greenery
from carlaloc_env.scenery.vegetation.land_cover import dress_land, is_tree

GREENS = ("green", "wood", "field", "residential")
"""Mapped areas on which plants are added."""
SOLID_PROPS = (
    ("bus_shelter", 0.8, 2.4),
    ("column", 0.65, 3.2),
    ("hydrant", 0.15, 0.7),
    ("planter", 0.5, 0.5),
)
"""Further props that a car can hit: name, radius and height of their prism [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Dressing:
    """Meshes and lights of things that were placed in a town."""

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
    lights, lenses, light_bases_m = add_signals(network, work.floor_height, ids)
    signs, sign_bases_m = add_signs(network, work.floor_height, ids)
    roadside = line_roads(out.solid, network, work, plots, config.roadside, ids)
    clear = [
        light_bases_m[:, :2],
        sign_bases_m[:, :2],
        *(walk.polygon_m[:, :2] for walk in network.crosswalks),
    ]
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
    bases_m = [base_m for bases_m in furnisher.placed.bases_m.values() for base_m in bases_m]
    posts_m = np.concatenate([np.array(bases_m, np.float64).reshape(-1, 3)[:, :2], *clear])
    add_street_greenery(street_green, land, plots.lots, posts_m)
    # After all else, so that nothing else changes its id.
    props += street_green.meshes(ids)
    _add_posts(out.solid, furnisher.placed, light_bases_m, green.bases_m(is_tree))
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


def _add_posts(solid: MeshBuilder, placed: Placement, light_bases_m: Array, trunks: Array) -> None:
    """Lamps, trunks, traffic lights and shelters as prisms that a car can hit."""
    groups = [(placed.bases_of("lamp"), 0.11, 8.0), (light_bases_m, 0.14, 6.0), (trunks, 0.17, 3.0)]
    groups += [(placed.bases_of(f"tree {kind}"), 0.17, 3.0) for kind in FORMS]
    groups += [(placed.bases_of(name), r, h) for name, r, h in SOLID_PROPS]
    for bases_m, radius, height in groups:
        solid.quads(posts(bases_m, radius, height), material=Material.PLAIN, tag=Tag.POLE)
