"""Single things that `town.toml` asks for, each at its place: monuments, filling stations, farms and more."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from carlaloc_env import rng
from carlaloc_env.materials import Material
from carlaloc_env.scene import Mesh
from carlaloc_env.semantics import Tag
from carlaloc_env.town.buildings import BuildingPlan, building_mesh, draw_look
from carlaloc_env.town.cells import cell_uv
from carlaloc_env.town.config import Feature
from carlaloc_env.town.copies import copies, poses
from carlaloc_env.town.meshing import MeshBuilder, box_quads
from carlaloc_env.town.polygons import Area, areas_only, triangulate
from carlaloc_env.town.styles import STYLES
from carlaloc_env.town.walls import around

Array = NDArray[np.float64]
HeightOf = Callable[[Array], Array]

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
}
"""Usual size of each kind along its heading and across it [m]."""
PAVED_KINDS = ("filling_station", "car_park", "farm")
"""Features that stand on a yard of concrete."""
VIADUCT_CLEAR_M = 6.2
"""Free height under a viaduct [m]."""
VIADUCT_WIDTH_M = 8.0
"""Width of its deck [m]."""
_STONE = (235, 228, 210)
_RED, _WHITE = (170, 18, 14), (235, 235, 230)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Site:
    """A feature and the ground that it takes."""

    feature: Feature
    """What stands there."""
    ground: Area
    """Where neither buildings nor trees stand."""


def sites(features: Sequence[Feature]) -> list[Site]:
    """Ground taken by each feature."""
    found = []
    for feature in features:
        length, depth = _extent(feature)
        corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * np.array([length, depth]) / 2
        found.append(Site(feature=feature, ground=shapely.Polygon(_placed(feature, corners))))
    return found


def feature_mesh(site: Site, paved: Area, floor: HeightOf, seed: int, instance: int) -> Mesh:
    """The mesh of one feature in the world; empty where nothing is built for its kind."""
    feature = site.feature
    if feature.kind in WORLD_MAKERS:
        return WORLD_MAKERS[feature.kind](feature, paved, floor).with_instance(instance)
    if feature.kind not in LOCAL_MAKERS:
        return MeshBuilder().build()
    local = LOCAL_MAKERS[feature.kind](feature, rng.stream(seed, f"feature/{feature.position}"))
    z = float(floor(np.array([feature.position], dtype=np.float64))[0])
    world = copies(local, poses([(*feature.position, z)], np.radians(feature.heading_deg)), instance)
    if feature.kind in PAVED_KINDS:
        out = MeshBuilder()
        out.add(_apron(areas_only(shapely.difference(site.ground, paved)), floor))
        out.add(world)
        return out.build()
    return world


def _extent(feature: Feature) -> tuple[float, float]:
    """Size [m] along the heading and across it."""
    along, across = EXTENTS_M[feature.kind]
    size = feature.size
    if feature.kind in ("viaduct", "gantry", "pier"):
        return (size[0] if size else along), across
    if feature.kind == "silo":
        return (size[0] + 1.0, size[0] + 1.0) if size else (along, across)
    if feature.kind == "billboard":
        return along, (size[0] if size else across)
    return (size[1] if len(size) > 1 else along), (size[0] if size else across)


def _placed(feature: Feature, xy: Array) -> Array:
    heading = np.radians(feature.heading_deg)
    c, s = np.cos(heading), np.sin(heading)
    x, y = xy.T
    return np.stack([feature.position[0] + c * x - s * y, feature.position[1] + s * x + c * y], axis=-1)


def _monument(_: Feature, __: np.random.Generator) -> Mesh:
    """An obelisk on steps, 13 m high."""
    out = MeshBuilder()
    steps = [(4.0, 0.35), (3.2, 0.7), (2.4, 1.05)]
    low = [(-half, -half, height - 0.35 if height > 0.4 else -0.5) for half, height in steps]
    high = [(half, half, height) for half, height in steps]
    out.quads(box_quads(low, high), material=Material.ASHLAR, tag=Tag.STATIC, colour=_STONE)
    plinth = box_quads(
        [(-1.3, -1.3, 1.05), (-1.5, -1.5, 3.1)], [(1.3, 1.3, 3.1), (1.5, 1.5, 3.45)], bottom=True
    )
    out.quads(plinth, material=Material.ASHLAR, tag=Tag.STATIC, colour=(215, 208, 190))
    ring = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], dtype=np.float64)
    levels = [(0.95, 3.45), (0.62, 11.8), (0.02, 13.0)]
    for (a, z0), (b, z1) in pairwise(levels):
        base = np.column_stack([ring * a, np.full(4, z0)])
        head = np.column_stack([ring * b, np.full(4, z1)])
        faces = np.stack([base, np.roll(base, -1, 0), np.roll(head, -1, 0), head], axis=1)
        out.quads(faces, material=Material.ASHLAR, tag=Tag.STATIC, colour=_STONE)
    for wall in around(2.6, 2.6):
        plate = wall.front(0.5, 2.1, 1.5, 2.6, 0.02) - np.array([1.3, 1.3, 0.0])
        out.quads(plate, material=Material.METAL_PAINTED, tag=Tag.STATIC, colour=(70, 55, 25))
    return out.build()


def _filling_station(_: Feature, __: np.random.Generator) -> Mesh:
    """Canopy, four pumps, a shop and a price sign; its front looks along +x."""
    out = MeshBuilder()
    posts = np.array([(x, y) for x in (-1.0, 7.0) for y in (-5.5, 5.5)])
    columns = box_quads(
        np.column_stack([posts - 0.2, np.full(4, -0.5)]), np.column_stack([posts + 0.2, np.full(4, 5.0)])
    )
    out.quads(columns, material=Material.METAL_PAINTED, tag=Tag.STATIC, colour=_WHITE)
    out.quads(
        box_quads([-3.0, -9.0, 5.0], [9.0, 9.0, 5.9], bottom=True),
        material=Material.METAL_PAINTED,
        tag=Tag.BUILDING,
        colour=_WHITE,
    )
    out.quads(
        box_quads([-3.04, -9.04, 5.25], [9.04, 9.04, 5.6]),
        material=Material.METAL_PAINTED,
        tag=Tag.BUILDING,
        colour=_RED,
    )
    lights = np.array([(x, y) for x in (0.0, 3.0, 6.0) for y in (-6.0, 0.0, 6.0)])
    z = np.full(len(lights), 4.985)
    corners = [np.column_stack([lights + d, z]) for d in ((-0.4, -0.4), (-0.4, 0.4), (0.4, 0.4), (0.4, -0.4))]
    out.quads(
        np.stack(corners, axis=1), material=Material.LAMP_WHITE, tag=Tag.BUILDING, colour=(120, 120, 115)
    )
    _pumps(out)
    _kiosk(out)
    _price_sign(out)
    return out.build()


def _pumps(out: MeshBuilder) -> None:
    for x in (0.0, 6.0):
        out.quads(
            box_quads([x - 0.6, -6.5, -0.1], [x + 0.6, 6.5, 0.16]), material=Material.KERB, tag=Tag.STATIC
        )
        for y in (-3.0, 3.0):
            body = box_quads([x - 0.3, y - 0.5, 0.16], [x + 0.3, y + 0.5, 1.9])
            out.quads(body, material=Material.METAL_PAINTED, tag=Tag.STATIC, colour=_WHITE)
            belt = box_quads([x - 0.32, y - 0.52, 1.45], [x + 0.32, y + 0.52, 1.8])
            out.quads(belt, material=Material.METAL_PAINTED, tag=Tag.STATIC, colour=_RED)


def _kiosk(out: MeshBuilder) -> None:
    """The shop behind the pumps, front along +x."""
    low, high = np.array([-12.5, -7.0, -0.5]), np.array([-6.0, 7.0, 3.8])
    out.quads(box_quads(low, high), material=Material.PLASTER, tag=Tag.BUILDING, colour=(240, 238, 230))
    y = np.array([-6.3, -3.1, 1.1, 4.3])
    zeros, face = np.zeros(4), np.full(4, -5.97)
    glass = np.stack(
        [
            np.column_stack([face, y + dy, zeros + z])
            for dy, z in ((0, 0.4), (2.4, 0.4), (2.4, 2.8), (0, 2.8))
        ],
        axis=1,
    )
    cells = cell_uv(Material.SHOP_FRONT, np.arange(4))
    out.quads(glass, material=Material.SHOP_FRONT, tag=Tag.BUILDING, uv_m=cells)
    door = np.array([[(-5.97, -0.5, 0.0), (-5.97, 0.8, 0.0), (-5.97, 0.8, 2.3), (-5.97, -0.5, 2.3)]])
    uv = cell_uv(Material.DOOR, np.array([1]))
    out.quads(door, material=Material.DOOR, tag=Tag.BUILDING, uv_m=uv)
    band = box_quads([-12.6, -7.1, 3.1], [-5.85, 7.1, 3.75])
    out.quads(band, material=Material.METAL_PAINTED, tag=Tag.BUILDING, colour=_RED)


def _price_sign(out: MeshBuilder) -> None:
    legs = box_quads([(11.4, 9.5, -0.3), (11.4, 11.3, -0.3)], [(11.6, 9.7, 3.2), (11.6, 11.5, 3.2)])
    out.quads(legs, material=Material.METAL_GALVANISED, tag=Tag.STATIC)
    board = box_quads([11.35, 9.4, 3.2], [11.65, 11.6, 7.0], bottom=True)
    out.quads(board, material=Material.METAL_PAINTED, tag=Tag.STATIC, colour=_RED)
    for x, sign in ((11.66, 1.0), (11.34, -1.0)):
        y0, y1 = (9.5, 11.5) if sign > 0 else (11.5, 9.5)
        z0, z1 = np.array([3.4, 4.6, 5.8]), np.array([4.4, 5.6, 6.8])
        plates = [
            np.column_stack([np.full(3, x), np.full(3, y), z])
            for y, z in ((y0, z0), (y1, z0), (y1, z1), (y0, z1))
        ]
        uv = cell_uv(Material.POSTER, np.array([2, 8, 15]), aspect=2.0)
        out.quads(np.stack(plates, axis=1), material=Material.POSTER, tag=Tag.STATIC, uv_m=uv)


def _apron(area: Area, floor: HeightOf) -> Mesh:
    out = MeshBuilder()
    xy, triangles = triangulate(area, 3.0)
    if len(xy):
        points = np.column_stack([xy, floor(xy) + 0.03])
        out.triangles(points, triangles, material=Material.CONCRETE, tag=Tag.GROUND, colour=(215, 212, 205))
    return out.build()


def _building(feature: Feature, draw: np.random.Generator) -> Mesh:
    """A civic building whose front looks along +x."""
    depth, width = _extent(feature)
    storeys = int(feature.size[2]) if len(feature.size) > 2 else 4
    look = draw_look(STYLES["civic"], draw)
    plan = BuildingPlan(look=look, width_m=width, depth_m=depth, storeys=storeys)
    mesh = building_mesh(plan, draw, 0)
    # The building's own front looks along −y from (0, 0) to (width, 0).
    turn = poses([(depth / 2, -width / 2, 0.0)], np.pi / 2)
    return copies(mesh, turn, 0)


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
        flat = _placed(feature, faces[..., :2].reshape(-1, 2))
        faces[..., :2] = flat.reshape(-1, 4, 2)
        out.quads(faces, material=material, tag=tag, colour=colour)

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
    """Places along the viaduct every 18 m, moved aside where a road or pavement lies below."""
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


WORLD_MAKERS: dict[str, Callable[[Feature, Area, HeightOf], Mesh]] = {"viaduct": _viaduct}
"""Features that follow the ground below them: from the feature, everything paved and the heights."""
LOCAL_MAKERS: dict[str, Callable[[Feature, np.random.Generator], Mesh]] = {
    "monument": _monument,
    "filling_station": _filling_station,
    "building": _building,
}
"""Features that stand level on their place, made round the origin with their front along +x."""
