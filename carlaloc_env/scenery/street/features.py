"""Features that `town.toml` asks for, each at its place: monuments, filling stations, farms and more."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from carlaloc_env.assets.billboards import billboard
from carlaloc_env.assets.construction_sites import construction_site
from carlaloc_env.assets.street_furniture import bus_shelter
from carlaloc_env.core import clock, elementary
from carlaloc_env.core.areas import Area, areas_only
from carlaloc_env.core.array_types import Array
from carlaloc_env.map.config import Feature
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.buildings.buildings import BuildingPlan, building_mesh, draw_appearance
from carlaloc_env.scenery.buildings.farms import barn, farm, silo
from carlaloc_env.scenery.buildings.filling_station import filling_station
from carlaloc_env.scenery.buildings.gatehouse import DEPTH_M as DEPTH_OVER_M
from carlaloc_env.scenery.buildings.gatehouse import WIDTH_M as WIDTH_OVER_M
from carlaloc_env.scenery.buildings.gatehouse import gatehouse, gatehouse_lamps
from carlaloc_env.scenery.buildings.monuments import fountain, monument
from carlaloc_env.scenery.buildings.styles import STYLES
from carlaloc_env.scenery.ground.height_fields import HeightOf
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder, box_quads, turned
from carlaloc_env.scenery.meshing.props import copies, poses
from carlaloc_env.scenery.street.car_parks import BAY_M, DEPTH_M, CarPark
from carlaloc_env.scenery.structures.footbridges import FOOTBRIDGE_CLEAR_M, footbridge, stair_length_m
from carlaloc_env.scenery.structures.footbridges import LENGTH_M as FOOTBRIDGE_M
from carlaloc_env.scenery.structures.gantries import gantry
from carlaloc_env.scenery.structures.jetties import jetty

EXTENTS_M: dict[str, tuple[float, float]] = {
    "filling_station": (27.0, 26.0),
    "monument": (9.0, 9.0),
    "viaduct": (200.0, 11.0),
    "building": (18.0, 30.0),
    "car_park": (36.0, 44.0),
    "bus_stop": (2.0, 4.4),
    "fountain": (9.0, 9.0),
    "farm": (42.0, 52.0),
    "barn": (13.0, 24.0),
    "silo": (6.0, 6.0),
    "billboard": (1.5, 6.4),
    "gantry": (14.0, 1.0),
    "construction_site": (28.0, 40.0),
    "pier": (60.0, 6.0),
    "gatehouse": (DEPTH_OVER_M, WIDTH_OVER_M),
    "footbridge": (FOOTBRIDGE_M, 3.0),
}
"""Usual size of each kind along its heading and across it [m]."""
PAVED_KINDS = ("filling_station", "farm")
"""Features that stand on a yard of concrete."""
VIADUCT_CLEAR_M = 6.2
"""Free height under a viaduct [m]."""
VIADUCT_WIDTH_M = 8.0
"""Width of its deck [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Site:
    """A feature and the ground that it takes."""

    feature: Feature
    """The feature."""
    ground: Area
    """Where neither buildings nor trees stand."""


def sites(features: Sequence[Feature]) -> list[Site]:
    """Ground taken by each feature."""
    places = []
    for feature in features:
        length, depth = _extent(feature)
        corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * np.array([length, depth]) / 2
        places.append(Site(feature=feature, ground=shapely.Polygon(_placed(feature, corners))))
    return places


def feature_mesh(site: Site, paved: Area, floor: HeightOf, seed: int, instance: int) -> Mesh:
    """The mesh of one feature in the world; empty where nothing is built for its kind."""
    feature = site.feature
    if feature.kind in WORLD_MAKERS:
        return WORLD_MAKERS[feature.kind](feature, paved, floor).with_instance(instance)
    if feature.kind not in LOCAL_MAKERS:
        return MeshBuilder().build()
    local = LOCAL_MAKERS[feature.kind](feature, clock.stream(seed, f"feature/{feature.position}"))
    z = float(floor(np.array([feature.position], dtype=np.float64))[0])
    world = copies(local, poses([(*feature.position, z)], np.radians(feature.heading_deg)), instance)
    if feature.kind in PAVED_KINDS:
        out = MeshBuilder()
        out.add(_apron(areas_only(shapely.difference(site.ground, paved)), floor))
        out.add(world)
        return out.build()
    return world


def feature_lamps(taken: Sequence[Site], paved: Area, floor: HeightOf) -> Array:
    """Light sources of features [m], shape (K, 3)."""
    lit = [gatehouse_lamps(s.feature, paved, floor) for s in taken if s.feature.kind == "gatehouse"]
    return np.concatenate([np.zeros((0, 3)), *lit])


def roofed_sites(taken: Sequence[Site]) -> Area:
    """Ground that features cover from above."""
    return shapely.union_all([site.ground for site in taken if site.feature.kind == "gatehouse"])


def spanning_sites(taken: Sequence[Site]) -> Area:
    """Ground below features that span roads, where no mast stands."""
    spans = ("footbridge", "gantry", "viaduct", "gatehouse")
    return shapely.union_all([site.ground for site in taken if site.feature.kind in spans])


def _extent(feature: Feature) -> tuple[float, float]:
    """Size [m] along the heading and across it."""
    along, across = EXTENTS_M[feature.kind]
    size = feature.size
    if feature.kind in ("viaduct", "gantry", "pier"):
        return (size[0] if size else along), across
    if feature.kind == "footbridge":
        return (size[0] if size else along) + 2.0 * stair_length_m(FOOTBRIDGE_CLEAR_M + 1.0), across
    if feature.kind == "silo":
        return (size[0] + 1.0, size[0] + 1.0) if size else (along, across)
    if feature.kind == "billboard":
        return along, (size[0] if size else across)
    return (size[1] if len(size) > 1 else along), (size[0] if size else across)


def _placed(feature: Feature, points: Array) -> Array:
    """Points (..., 2 or 3) of a feature's frame in the world; heights stay."""
    return turned(points, feature.position, np.radians(feature.heading_deg))


def _apron(area: Area, floor: HeightOf) -> Mesh:
    out = MeshBuilder()
    grey = (215, 212, 205)
    out.sheet(area, 3.0, floor, lift_m=0.03, material=Material.CONCRETE, tag=Tag.GROUND, colour=grey)
    return out.build()


def _building(feature: Feature, draw: np.random.Generator) -> Mesh:
    """A civic building whose front looks along +x."""
    depth, width = _extent(feature)
    storeys = int(feature.size[2]) if len(feature.size) > 2 else 4
    appearance = draw_appearance(STYLES["civic"], draw)
    plan = BuildingPlan(appearance=appearance, width_m=width, depth_m=depth, storeys=storeys)
    mesh = building_mesh(plan, draw, 0)
    # The building's own front looks along −y from (0, 0) to (width, 0).
    turn = poses([(depth / 2, -width / 2, 0.0)], np.pi / 2)
    return copies(mesh, turn, 0)


def _billboard(feature: Feature, draw: np.random.Generator) -> Mesh:
    size = {"width_m": feature.size[0], "height_m": feature.size[1]} if len(feature.size) > 1 else {}
    return billboard(int(draw.integers(0, 8)), **size)


def feature_car_parks(features: Sequence[Feature]) -> list[CarPark]:
    """Car parks asked for by `town.toml`, as many side by side as their ground holds."""
    parks = []
    for number, feature in enumerate(features):
        if feature.kind != "car_park":
            continue
        depth, width = _extent(feature)
        bays, rows = max(4, int((width - 1.0) / BAY_M[0])), max(1, int(depth / DEPTH_M))
        heading = np.radians(feature.heading_deg)
        inward = -np.array([elementary.cos(heading), elementary.sin(heading)])
        along = np.array([-inward[1], inward[0]])
        for row in range(rows):
            away = row * DEPTH_M - rows * DEPTH_M / 2
            corner = np.array(feature.position) - along * (bays * BAY_M[0] + 1.0) / 2 + inward * away
            name = f"feature {number}/{row}"
            parks.append(CarPark(corner_m=corner, along=along, inward=inward, bays=bays, name=name))
    return parks


def _viaduct(feature: Feature, paved: Area, floor: HeightOf) -> Mesh:
    """An elevated railway: deck on piers that stand beside the roads below."""
    out = MeshBuilder()
    length = _extent(feature)[0]
    along = np.linspace(-length / 2, length / 2, int(length / 10.0) + 1)
    ground = floor(_placed(feature, np.column_stack([along, np.zeros_like(along)])))
    under = float(np.max(ground)) + VIADUCT_CLEAR_M
    half = VIADUCT_WIDTH_M / 2

    def box(low: Array, high: Array, material: Material, tag: Tag, colour: tuple[int, int, int]) -> None:
        faces = box_quads(low, high, bottom=True)
        out.quads(_placed(feature, faces), material=material, tag=tag, colour=colour)

    starts = along[:-1]
    row = np.ones(len(starts))

    def beams(y0: float, y1: float, z0: float, z1: float, material: Material, tag: Tag, grey: int) -> None:
        low = np.column_stack([starts, row * y0, row * (under + z0)])
        high = np.column_stack([along[1:], row * y1, row * (under + z1)])
        box(low, high, material, tag, (grey, grey, grey - 4))

    beams(-half, half, 0.9, 1.3, Material.CONCRETE, Tag.BRIDGE, 205)
    for y in (-half + 1.2, half - 1.6):
        beams(y, y + 0.4, 0.0, 0.9, Material.METAL_PAINTED, Tag.BRIDGE, 80)
    for y in (-half, half - 0.2):
        beams(y, y + 0.2, 1.3, 2.2, Material.CONCRETE, Tag.BRIDGE, 215)
    for y in (-2.7, -1.25, 1.25, 2.7):
        beams(y - 0.04, y + 0.04, 1.3, 1.46, Material.METAL_GALVANISED, Tag.RAIL_TRACK, 170)
    for x in _pier_places(feature, paved, length):
        foot = float(floor(_placed(feature, np.array([[x, 0.0]])))[0]) - 0.6
        for y in (-half + 1.4, half - 1.4):
            low, high = np.array([x - 0.45, y - 0.45, foot]), np.array([x + 0.45, y + 0.45, under])
            box(low, high, Material.CONCRETE, Tag.BRIDGE, (200, 198, 192))
        low, high = np.array([x - 0.5, -half, under - 0.8]), np.array([x + 0.5, half, under])
        box(low, high, Material.CONCRETE, Tag.BRIDGE, (210, 208, 202))
    return out.build()


def _pier_places(feature: Feature, paved: Area, length_m: float) -> list[float]:
    """Places along the viaduct every 18 m, moved aside where a road or sidewalk lies below."""
    near = shapely.buffer(paved, 0.4)
    shapely.prepare(near)
    places: list[float] = []
    for x in np.arange(-length_m / 2 + 2.0, length_m / 2, 18.0):
        for shift in (0.0, 2.0, -2.0, 4.0, -4.0, 6.0, -6.0):
            foot = shapely.box(x + shift - 0.6, -VIADUCT_WIDTH_M / 2, x + shift + 0.6, VIADUCT_WIDTH_M / 2)
            ring = _placed(feature, shapely.get_coordinates(foot)[:4])
            if not shapely.intersects(near, shapely.Polygon(ring)):
                places.append(float(x + shift))
                break
    return places


WORLD_MAKERS: dict[str, Callable[[Feature, Area, HeightOf], Mesh]] = {
    "viaduct": _viaduct,
    "gantry": gantry,
    "pier": jetty,
    "gatehouse": gatehouse,
    "footbridge": footbridge,
}
"""Features that follow the ground below them: from the feature, everything paved and the heights."""


LOCAL_MAKERS: dict[str, Callable[[Feature, np.random.Generator], Mesh]] = {
    "monument": lambda _, __: monument(),
    "fountain": lambda _, __: fountain(),
    "filling_station": lambda _, __: filling_station(),
    "building": _building,
    "bus_stop": lambda _, draw: bus_shelter(int(draw.integers(0, 16))),
    "farm": lambda feature, draw: farm(*_extent(feature)[::-1], draw),
    "barn": lambda feature, draw: barn(*_extent(feature)[::-1], draw),
    "silo": lambda feature, _: silo(*feature.size[:2]),
    "billboard": _billboard,
    "construction_site": lambda feature, draw: construction_site(*_extent(feature)[::-1], draw),
}
"""Features that stand level on their place, made round the origin with their front along +x."""
