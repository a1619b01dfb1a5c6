"""What stands beside roads rather than on sidewalks: rails, masts, wires, parked cars, car parks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from carlaloc_env.assets.street.fences_and_poles import delineator
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.town.config import RoadsideConfig
from carlaloc_env.town.ground.lane_strips import Strip
from carlaloc_env.town.ground.paved_areas import TownAreas
from carlaloc_env.town.ground.road_edges import RoadEdge
from carlaloc_env.town.ground.terrain import Terrain
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.town.lanes.records import Crosswalk
from carlaloc_env.town.meshing.collision_mesh import posts
from carlaloc_env.town.meshing.instance_ids import InstanceIds
from carlaloc_env.town.meshing.mesh_builder import MeshBuilder
from carlaloc_env.town.meshing.polygons import Area
from carlaloc_env.town.meshing.prop_batches import PropField
from carlaloc_env.town.meshing.prop_copies import copies, poses
from carlaloc_env.town.opendrive.records import Road
from carlaloc_env.town.street.car_parks import CarPark, add_car_park
from carlaloc_env.town.street.parked_cars import ParkedCars, lay_drives, park_in_lanes, park_on_verges
from carlaloc_env.town.structures.delineators import delineator_feet
from carlaloc_env.town.structures.exit_signs import add_exit_signs
from carlaloc_env.town.structures.guard_rails import add_guard_rails, add_medians
from carlaloc_env.town.structures.overhead_lines import POLE_M, add_lines, corridor, place_lines
from carlaloc_env.town.structures.street_lights import mast_meshes
from carlaloc_env.town.structures.wire_fences import add_wire_fences

SIGN_CLEAR_M = 2.6
"""Nothing else stands nearer to the foot of a direction sign [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RoadsideSite:
    """What the roadside must know of a town."""

    network: LaneNetwork
    """Lanes of all roads."""
    config: RoadsideConfig
    """What is wanted."""
    strips: Sequence[Strip]
    """All roads."""
    roads: Sequence[Road]
    """All roads of the map."""
    edges: Sequence[RoadEdge]
    """Edges of all roads outside junctions."""
    areas: TownAreas
    """Plan-view areas."""
    zones: Sequence[tuple[str, Area]]
    """Kinds of scenery with their areas."""
    crosswalks: Sequence[Crosswalk]
    """Crosswalks, before which nobody parks."""
    ground: Terrain
    """Heights of the ground."""
    blocked: Area
    """Buildings, car parks and whatever else is reserved, without what is paved."""
    built: Area
    """Buildings and features alone."""
    overhead: Area
    """Raised roads."""
    spans: Area
    """Ground below gantries, footbridges and other features that span roads."""
    car_parks: Sequence[CarPark]
    """Car parks to be laid out."""
    seed: int
    """Seed of the town."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Roadside:
    """What was placed."""

    meshes: list[Mesh]
    """All that is seen."""
    lamps_m: Array
    """Lights of the masts [m], shape (K, 3)."""
    taken: Area
    """Ground on which nothing else may grow or stand."""


def line_roads(solid: MeshBuilder, site: RoadsideSite, ids: InstanceIds) -> Roadside:
    """Line all roads; solid things also go to `solid`."""
    fittings, cars = MeshBuilder(), ParkedCars()
    paved = site.areas.paved
    rails = add_guard_rails(fittings, solid, site.edges, paved, site.ground)
    medians = add_medians(fittings, solid, site.strips, site.roads)
    for park in site.car_parks:
        add_car_park(fittings, cars, park, site.ground, site.seed, ids.take())
    masts, lights, feet = mast_meshes(
        site.edges, medians, site.zones, paved, site.spans, site.ground, site.overhead, ids
    )
    markers, yaws = np.zeros((0, 3)), np.zeros(0)
    if site.config.delineators:
        markers, yaws = delineator_feet(
            site.edges, site.zones, shapely.union(paved, site.blocked), site.ground
        )
    if len(markers):
        masts.append(copies(delineator(), poses(markers, yaws), ids.take(len(markers))))
    signs, sign_feet = PropField(), np.zeros((0, 3))
    if site.config.exit_signs:
        kept = shapely.union_all([site.built, site.spans, *_discs(feet)])
        sign_feet = add_exit_signs(signs, site.network, paved, kept, site.overhead, site.ground.height)
    masts += signs.meshes(ids)
    blocked = shapely.union_all([site.blocked, paved, rails, *_discs(feet)])
    blocked = shapely.union_all([blocked, *_discs(markers), *_discs(sign_feet, SIGN_CLEAR_M)])
    rows = place_lines(site.edges, site.zones, blocked, site.overhead, site.ground, site.seed)
    poles, pole_feet = add_lines(fittings, rows, ids)
    blocked = shapely.union_all([blocked, *_discs(pole_feet)])
    walks = shapely.union_all([shapely.Polygon(walk.polygon_m[:, :2]) for walk in site.crosswalks])
    park_in_lanes(cars, site.strips, site.zones, walks, site.seed)
    beside = shapely.union(blocked, shapely.buffer(walks, 4.0))
    drives = lay_drives(fittings, cars, site.edges, site.zones, blocked, site.ground, site.seed)
    beside = shapely.union_all([beside, *drives])
    park_on_verges(cars, site.edges, site.zones, beside, site.ground, site.seed)
    fenced = add_wire_fences(
        fittings, solid, site.edges, site.zones, shapely.union_all([beside, *cars.footprints()]), site.ground
    )
    cars.add_boxes(solid)
    for places, radius, height in ((feet, 0.11, 8.0), (pole_feet, 0.15, POLE_M), (sign_feet, 0.3, 3.0)):
        if len(places):
            faces = posts(places, np.full(len(places), radius), np.full(len(places), height))
            solid.quads(faces, material=Material.PLAIN, tag=Tag.POLE)
    taken = [
        rails,
        fenced,
        corridor(rows),
        *drives,
        *cars.footprints(),
        *(park.area() for park in site.car_parks),
    ]
    return Roadside(
        meshes=[fittings.build(), *masts, *poles, *cars.meshes(ids)],
        lamps_m=lights,
        taken=shapely.union_all([*taken, *_discs(feet), *_discs(markers), *_discs(sign_feet, SIGN_CLEAR_M)]),
    )


def _discs(feet: Array, radius_m: float = 0.6) -> list[Area]:
    return list(shapely.buffer(shapely.points(feet[:, :2]), radius_m)) if len(feet) else []
