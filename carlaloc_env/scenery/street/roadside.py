"""Things beside roads rather than on sidewalks: rails, masts, wires, parked cars, car parks."""

from dataclasses import dataclass

import numpy as np
import shapely

from carlaloc_env.assets.posts_and_fences import delineator
from carlaloc_env.core.areas import Area
from carlaloc_env.core.array_types import Array
from carlaloc_env.map.config import RoadsideConfig
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.ground_plan import Groundwork
from carlaloc_env.scenery.meshing.collision_mesh import posts
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.meshing.props import InstanceIds, PropField, copies, poses
from carlaloc_env.scenery.street.car_parks import add_car_park
from carlaloc_env.scenery.street.features import spanning_sites
from carlaloc_env.scenery.street.parked_cars import ParkedCars, lay_drives, park_in_lanes, park_on_verges
from carlaloc_env.scenery.street.site_plan import Plots
from carlaloc_env.scenery.structures.delineators import delineator_bases
from carlaloc_env.scenery.structures.exit_signs import add_exit_signs
from carlaloc_env.scenery.structures.guard_rails import add_guard_rails, add_medians
from carlaloc_env.scenery.structures.lamp_masts import mast_meshes
from carlaloc_env.scenery.structures.power_lines import POLE_M, add_lines, corridor, place_lines
from carlaloc_env.scenery.structures.wire_fences import add_wire_fences

SIGN_CLEAR_M = 2.6
"""Nothing else stands nearer to the foot of a direction sign [m]."""
FOOT_CLEAR_M, CROSSWALK_CLEAR_M = 0.6, 4.0
"""The same of masts, posts and poles, and of crosswalks beside which no car stands on a verge [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Roadside:
    """Things that were placed beside the roads, and the ground that they take."""

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
    masts, lights, bases_m = mast_meshes(ways, medians, paved, spans, work.overhead, ids)
    markers, yaws = np.zeros((0, 3)), np.zeros(0)
    if config.delineators:
        markers, yaws = delineator_bases(ways, shapely.union(paved, reserved))
    if len(markers):
        masts.append(copies(delineator(), poses(markers, yaws), ids.take(len(markers))))
    signs, sign_bases_m = PropField(), np.zeros((0, 3))
    if config.exit_signs:
        built = _Occupied(*(site.ground for site in plots.features), *plots.footprints())
        built.add(spans, *_discs(bases_m))
        sign_bases_m = add_exit_signs(signs, network, paved, built.area, work.overhead, ways.ground.height)
    masts += signs.meshes(ids)
    taken = _Occupied(reserved, paved, rails, *_discs(bases_m))
    taken.add(*_discs(markers), *_discs(sign_bases_m, SIGN_CLEAR_M))
    rows = place_lines(ways, taken.area, work.overhead)
    poles, pole_bases_m = add_lines(fittings, rows, ids)
    taken.add(*_discs(pole_bases_m))
    walks = shapely.union_all([shapely.Polygon(walk.polygon_m[:, :2]) for walk in network.crosswalks])
    park_in_lanes(cars, work.strips, ways, walks)
    drives = lay_drives(fittings, cars, ways, taken.area)
    taken.add(shapely.buffer(walks, CROSSWALK_CLEAR_M))
    taken.add(*drives)
    park_on_verges(cars, ways, taken.area)
    taken.add(*cars.footprints())
    fenced = add_wire_fences(fittings, solid, ways, taken.area)
    cars.add_boxes(solid)
    for places, radius, height in (
        (bases_m, 0.11, 8.0),
        (pole_bases_m, 0.15, POLE_M),
        (sign_bases_m, 0.3, 3.0),
    ):
        solid.quads(posts(places, radius, height), material=Material.PLAIN, tag=Tag.POLE)
    parks = [park.area() for park in plots.car_parks]
    grounds = [rails, fenced, corridor(rows), *drives, *cars.footprints(), *parks]
    discs = [*_discs(bases_m), *_discs(markers), *_discs(sign_bases_m, SIGN_CLEAR_M)]
    return Roadside(
        meshes=[fittings.build(), *masts, *poles, *cars.meshes(ids)],
        lamps_m=lights,
        taken=shapely.union_all([*grounds, *discs]),
    )


def _discs(bases_m: Array, radius_m: float = FOOT_CLEAR_M) -> list[Area]:
    return list(shapely.buffer(shapely.points(bases_m[:, :2]), radius_m)) if len(bases_m) else []
