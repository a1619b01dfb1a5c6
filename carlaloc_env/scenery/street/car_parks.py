"""Car parks: a surface with bays on both sides of an aisle, cars in most of them, a fence and a sign."""

from dataclasses import dataclass

import numpy as np
import shapely

from carlaloc_env.assets.posts_and_fences import fence
from carlaloc_env.assets.signs import sign
from carlaloc_env.core import clock, elementary
from carlaloc_env.core.areas import Area
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.grade_levels import State
from carlaloc_env.scenery.ground.road_edges import Waysides
from carlaloc_env.scenery.ground.terrain import Terrain
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder
from carlaloc_env.scenery.meshing.props import copies, poses
from carlaloc_env.scenery.street.parked_cars import ParkedCars

BAY_M = (2.5, 5.0)
"""Width and length of a bay [m]."""
AISLE_M = 6.4
"""Width of the aisle between the rows [m]."""
DEPTH_M = 2 * BAY_M[1] + AISLE_M + 0.6
"""Depth of a car park [m]."""
BAYS = (8, 14)
"""Least and most bays in a row."""
STEEPEST_M = 0.7
"""Ground that differs by more inside a car park is too steep [m]."""
FRACTIONS = {"downtown": 0.12, "small_town": 0.22, "industrial": 0.4, "residential": 0.06, "waterfront": 0.2}
"""Share of the long streets of a zone that have one on a side."""
OCCUPIED = 0.62
"""Share of the bays that are taken."""
_LINE_M = 0.1
_LIFT_M = 0.03


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CarPark:
    """A car park beside a street."""

    corner_m: Array
    """Its corner at the street, left seen from the street [m], shape (2,)."""
    along: Array
    """Unit vector along the street, to the right seen from the street, shape (2,)."""
    inward: Array
    """Unit vector away from the street, shape (2,)."""
    bays: int
    """Bays in a row."""
    name: str
    """Name of its random stream."""

    @property
    def width_m(self) -> float:
        """Extent along the street [m]."""
        return self.bays * BAY_M[0] + 1.0

    def points(self, along_m: Array, inward_m: Array) -> Array:
        """World points (N, 2) from distances along the street and away from it."""
        a, b = np.broadcast_arrays(along_m, inward_m)
        return np.asarray(self.corner_m + a[..., None] * self.along + b[..., None] * self.inward)

    def face_up(self, faces: Array) -> Array:
        """Faces (N, K, 3) of points along and away from the street, turned so that they look up."""
        upwards = self.along[0] * self.inward[1] - self.along[1] * self.inward[0] > 0
        return faces if upwards else faces[:, ::-1]

    def area(self) -> Area:
        """Its ground."""
        w = self.width_m
        return shapely.Polygon(self.points(np.array([0, w, w, 0.0]), np.array([0, 0, DEPTH_M, DEPTH_M])))


def place_car_parks(ways: Waysides, blocked: Area) -> list[CarPark]:
    """Car parks along streets with sidewalks, where nothing else is in the way."""
    shapely.prepare(blocked)
    parks: list[CarPark] = []
    for edge in ways.edges:
        draw = clock.stream(ways.seed, f"car park/{edge.name}")
        kind = ways.zones.kind_at(edge.line_m[len(edge.line_m) // 2])
        bays = int(draw.integers(BAYS[0], BAYS[1] + 1))
        share, chance = float(draw.uniform(0.2, 0.8)), draw.random()
        room = len(edge.line_m) - bays * BAY_M[0] - 14.0
        if not edge.sidewalk or chance > FRACTIONS.get(kind, 0.0) or room < 4.0:
            continue
        start = 7 + int(share * room)
        end = start + int(bays * BAY_M[0]) + 1
        a, b = edge.line_m[start, :2], edge.line_m[end, :2]
        along = (b - a) / np.hypot(*(b - a))
        inward = np.array([along[1], -along[0]])
        bow = np.abs(np.sum((edge.line_m[start:end, :2] - a) * inward, axis=1)).max()
        if bow > 0.4 or (edge.state[start:end] != State.GROUND).any():
            continue
        # Seen from the street the line's free side is its right: its end is the left corner.
        park = CarPark(
            corner_m=a + inward * (bow + 0.12), along=along, inward=inward, bays=bays, name=edge.name
        )
        corners = park.points(*np.meshgrid(np.linspace(0, park.width_m, 5), np.linspace(0, DEPTH_M, 4)))
        z = ways.ground.height(corners.reshape(-1, 2))
        clear = not shapely.intersects(blocked, shapely.buffer(park.area(), -0.2))
        alone = not any(shapely.dwithin(park.area(), other.area(), 8.0) for other in parks)
        if np.ptp(z) < STEEPEST_M and clear and alone:
            parks.append(park)
    return parks


def add_car_park(out: MeshBuilder, cars: ParkedCars, park: CarPark, ways: Waysides, instance: int) -> None:
    """Surface, lines, cars, fence and sign of one car park."""
    ground = ways.ground
    draw = clock.stream(ways.seed, f"car park/{park.name}", index=1)
    _surface(out, park, ground)
    _lines(out, park, ground)
    entrance = 1 + int(draw.integers(park.bays - 3))
    for row, (depth, turn) in enumerate(((0.3 + BAY_M[1] / 2, 0.0), (DEPTH_M - 0.3 - BAY_M[1] / 2, np.pi))):
        for bay in range(park.bays):
            if draw.random() > OCCUPIED or (row == 0 and entrance <= bay < entrance + 2):
                continue
            spot = park.points(np.array(0.5 + (bay + 0.5) * BAY_M[0]), np.array(depth))
            heading = float(elementary.arctan2(-park.inward[1], -park.inward[0])) + turn
            yaw = heading + (np.pi if draw.random() < 0.3 else 0.0)
            cars.put(np.array([*spot, float(ground.height(spot[None])[0]) + _LIFT_M]), yaw, draw)
    _fences(out, park, ground, instance)
    post = park.points(np.array(0.5 + entrance * BAY_M[0] - 0.4), np.array(0.5))
    base_m = np.array([*post, float(ground.height(post[None])[0])])
    facing = float(elementary.arctan2(-park.inward[1], -park.inward[0]))
    out.add(copies(sign("parking"), poses(base_m, facing), instance))


def _surface(out: MeshBuilder, park: CarPark, ground: Terrain) -> None:
    a = np.linspace(0.0, park.width_m, max(3, int(park.width_m / 3.0)))
    b = np.linspace(-0.06, DEPTH_M, 7)
    xy = park.points(*np.meshgrid(a, b, indexing="ij"))
    z = ground.height(xy.reshape(-1, 2)).reshape(xy.shape[:2]) + _LIFT_M - 0.01
    points = park.face_up(np.concatenate([xy, z[..., None]], axis=-1))
    out.grid(points, material=Material.ASPHALT_OLD, tag=Tag.GROUND, colour=(228, 226, 222))


def _lines(out: MeshBuilder, park: CarPark, ground: Terrain) -> None:
    quads = []
    for depth in (0.3, DEPTH_M - 0.3 - BAY_M[1]):
        for bay in range(park.bays + 1):
            at = 0.5 + bay * BAY_M[0]
            a = np.array([at - _LINE_M / 2, at + _LINE_M / 2] * 2)
            for piece in range(2):
                low, high = depth + piece * BAY_M[1] / 2, depth + (piece + 1) * BAY_M[1] / 2
                quads.append(park.points(a[[0, 1, 1, 0]], np.array([low, low, high, high])))
    xy = np.array(quads)
    z = ground.height(xy.reshape(-1, 2)).reshape(xy.shape[:2]) + _LIFT_M + 0.008
    points = park.face_up(np.concatenate([xy, z[..., None]], axis=-1))
    out.quads(points, material=Material.ROAD_PAINT_WHITE, tag=Tag.ROAD_LINE)


def _fences(out: MeshBuilder, park: CarPark, ground: Terrain, instance: int) -> None:
    """Three sides; the street's side is open."""
    w, d, step = park.width_m, DEPTH_M, 3.0
    sides = (
        (park.points(np.array(0.0), np.array(0.3)), park.inward, d - 0.3),
        (park.points(np.array(0.0), np.array(d)), park.along, w),
        (park.points(np.array(w), np.array(0.3)), park.inward, d - 0.3),
    )
    bases_m, yaws = [], []
    for start, direction, length in sides:
        count = int(length / step)
        for k in range(count):
            xy = start + direction * k * length / count
            bases_m.append([*xy, float(ground.height(xy[None])[0])])
            yaws.append(float(elementary.arctan2(direction[1], direction[0])))
    out.add(copies(fence(3.0, 1.0, kind="rails"), poses(np.array(bases_m), np.array(yaws)), instance))
