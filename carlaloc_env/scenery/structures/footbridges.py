"""Footbridges, sign gantries and jetties.

Footbridges over wide roads: a deck between two stairs, with piers where the roads below leave room.

Features that belong to roads and shores: sign gantries and piers.
"""

import itertools
from collections.abc import Callable

import numpy as np
import shapely

from carlaloc_env.assets.direction_signs import BOARD_M, CLEAR_M, direction_board
from carlaloc_env.assets.primitives import Look, box, placed, tube
from carlaloc_env.assets.street_furniture import bench, bollard, lamp
from carlaloc_env.core import elementary
from carlaloc_env.core.areas import Area
from carlaloc_env.core.array_types import Array
from carlaloc_env.map.config import Feature
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.height_fields import HeightOf
from carlaloc_env.scenery.meshing.batches import copies, poses

FOOTBRIDGE_CLEAR_M, DEPTH_M, WIDTH_M = 5.7, 0.9, 2.8
"""Free height under the deck, its depth and width [m]."""
LENGTH_M = 44.0
"""Usual length of the deck [m]."""
RAILING_M, POST_STEP_M = 1.1, 2.0
"""Height of the railing and distance of its posts [m]."""
STEP_RISE_M, STEP_GOING_M = 0.16, 0.31
"""Rise and going of a stair's steps [m]."""
LANDING_M = 1.4
"""Length of the landing half-way [m]."""
PIER_CLEAR_M, PIER_M = 0.9, 0.5
"""Distance of piers from everything paved, and their radius [m]."""
LONGEST_SPAN_M = 26.0
"""A pier stands wherever there is room in a span longer than this [m]."""
_CONCRETE = Look(Material.CONCRETE, Tag.BRIDGE, (214, 212, 206))
_DIM = Look(Material.CONCRETE, Tag.BRIDGE, (196, 194, 188))
_STEEL = Look(Material.METAL_GALVANISED, Tag.GUARD_RAIL, (190, 192, 194))


def footbridge(feature: Feature, paved: Area, floor: HeightOf) -> Mesh:
    """Footbridge whose deck runs along the heading; the stairs at its ends go on in line."""
    length = feature.size[0] if feature.size else LENGTH_M
    centre, heading = np.array(feature.position), np.radians(feature.heading_deg)
    along = np.array([elementary.cos(heading), elementary.sin(heading)])
    station = np.linspace(-0.5 * length, 0.5 * length, int(length) + 1)
    places = centre + station[:, None] * along
    shapely.prepare(paved)
    distance = shapely.distance(paved, shapely.points(places))
    road = distance < 0.1
    low = float(floor(places[road] if road.any() else places).max())
    top = low + FOOTBRIDGE_CLEAR_M + DEPTH_M
    parts = [
        box(_CONCRETE, (length, WIDTH_M, 0.35), (0.0, 0.0, top - 0.175)),
        box(_DIM, (length, 1.5, DEPTH_M - 0.35), (0.0, 0.0, top - 0.35 - 0.5 * (DEPTH_M - 0.35))),
    ]
    for y in (-0.5 * WIDTH_M + 0.12, 0.5 * WIDTH_M - 0.12):
        parts += _railing((-0.5 * length, y, top), (0.5 * length, y, top))

    def ground(x: float) -> float:
        return float(floor((centre + x * along)[None])[0])

    for x in pier_places(station, distance):
        parts.append(tube(_CONCRETE, [(x, 0.0, ground(x) - 0.6), (x, 0.0, top - DEPTH_M + 0.02)], PIER_M, 14))
    for end in (-0.5 * length, 0.5 * length):
        parts += _stairs(end, top, ground)
        foot = ground(end) - 0.6
        column = (0.9, WIDTH_M, top - DEPTH_M - foot + 0.02)
        parts.append(box(_CONCRETE, column, (0.98 * end, 0.0, foot + 0.5 * column[2])))
    return copies(merge(parts), poses([(*centre, 0.0)], heading), 0)


def pier_places(station_m: Array, distance_m: Array) -> list[float]:
    """Stations of piers [m]: beside the outermost roads, and between roads where a span would be too long.

    Args:
        station_m: Stations along the deck [m], shape (N,).
        distance_m: Distance of each from what is paved [m], shape (N,).
    """
    free = np.flatnonzero(distance_m > PIER_CLEAR_M + PIER_M)
    free = free[(free > 1) & (free < len(station_m) - 2)]
    road = np.flatnonzero(distance_m <= 0.1)
    if not len(free) or not len(road):
        return [float(station_m[len(station_m) // 2])] if len(free) else []
    before, after = free[free < road[0]], free[free > road[-1]]
    chosen = [
        int(side) for side in ([before[-1]] if len(before) else []) + ([after[0]] if len(after) else [])
    ]
    inside = free[(free > road[0]) & (free < road[-1])]
    if len(inside) and station_m[road[-1]] - station_m[road[0]] > LONGEST_SPAN_M:
        # The widest gap between the roads, in its middle.
        chosen.append(int(inside[np.argmax(distance_m[inside])]))
    return [float(station_m[k]) for k in sorted(set(chosen))]


def _railing(start: tuple[float, float, float], end: tuple[float, float, float]) -> list[Mesh]:
    """Posts, a handrail and bars between two points of a walkway."""
    a, b = np.array(start), np.array(end)
    length = float(np.hypot(*(b - a)[:2]))
    count = max(round(length / POST_STEP_M), 1) + 1
    up = np.array([0.0, 0.0, 1.0])
    feet = a + np.linspace(0.0, 1.0, count)[:, None] * (b - a)
    parts = [box(_STEEL, (0.08, 0.08, RAILING_M), foot + 0.5 * RAILING_M * up) for foot in feet]
    for height, radius in ((RAILING_M, 0.035), (0.72, 0.02), (0.38, 0.02)):
        parts.append(tube(_STEEL, [a + height * up, b + height * up], radius, 6, caps=False))
    return parts


def _stairs(x: float, top: float, ground: Callable[[float], float]) -> list[Mesh]:
    """A straight flight from the deck's end at x outwards, with a landing half-way.

    Args:
        x: Where it begins, along the bridge [m].
        top: Height there [m].
        ground: Height of the ground along the bridge [m].
    """
    out = 1.0 if x > 0 else -1.0
    count = max(int((top - ground(x + out * stair_length_m(top - ground(x)))) / STEP_RISE_M), 1)
    parts, bends, z = [], [(x, top)], top
    for k in range(count + 1):
        landing = k == count // 2
        going = LANDING_M if landing else STEP_GOING_M
        if landing:
            bends += [(x, z), (x + out * going, z)]
        else:
            z -= STEP_RISE_M
        parts.append(box(_CONCRETE, (going, 0.5 * WIDTH_M, 0.3), (x + 0.5 * out * going, 0.0, z - 0.15)))
        x += out * going
    bends.append((x, z))
    for y in (-0.25 * WIDTH_M + 0.08, 0.25 * WIDTH_M - 0.08):
        for (x0, z0), (x1, z1) in itertools.pairwise(bends):
            parts += _railing((x0, y, z0), (x1, y, z1))
    middle, height = bends[1][0] + 0.5 * out * LANDING_M, bends[1][1] - 0.3
    foot = ground(middle) - 0.6
    parts.append(box(_CONCRETE, (0.6, 0.6, height - foot), (middle, 0.0, 0.5 * (foot + height))))
    return parts


def stair_length_m(height_m: float) -> float:
    """Length of a stair in plan [m]."""
    return height_m / STEP_RISE_M * STEP_GOING_M + LANDING_M


LONGEST_GANTRY_M = 45.0
"""Farthest that a gantry reaches to each side of its place [m]."""
POST_CLEAR_M = 1.0
"""Distance of its posts from everything paved [m]."""
PIER_WIDTH_M, SMALL_PIER_M = 6.0, 40.0
"""Width of a pier [m]; shorter ones are half as wide."""
_GANTRY_STEEL = Look(Material.METAL_GALVANISED, Tag.POLE, (195, 198, 200))
_WOOD = Look(Material.WOOD, Tag.STATIC, (200, 190, 175))


def gantry(feature: Feature, paved: Area, floor: HeightOf) -> Mesh:
    """Gantry over a whole road: boards towards both directions; its front looks along the heading."""
    centre, heading = np.array(feature.position), np.radians(feature.heading_deg)
    # Drivers who see the front drive against the heading and keep to the right.
    right = np.array([-elementary.sin(heading), elementary.cos(heading)])
    shapely.prepare(paved)
    reach = [_reach(centre, sign * right, paved) for sign in (1.0, -1.0)]
    feet = np.array([centre + reach[0] * right, centre - reach[1] * right])
    across = centre + np.linspace(-reach[1], reach[0], 15)[:, None] * right
    low = float(floor(across).max())
    z = low + CLEAR_M + 0.3
    parts = []
    for y, foot in ((reach[0], feet[0]), (-reach[1], feet[1])):
        base = float(floor(foot[None])[0])
        parts.append(tube(_GANTRY_STEEL, [(-0.2, y, base - 0.3), (-0.2, y, z + 2.2)], [0.26, 0.2], 12))
    for dz in (0.5, 1.9):
        length = reach[0] + reach[1]
        parts.append(box(_GANTRY_STEEL, (0.16, length, 0.16), (-0.2, 0.5 * (reach[0] - reach[1]), z + dz)))
    for k, y in enumerate(np.arange(-reach[1] + 0.5, reach[0] - 1.0, 1.4)):
        ends = (z + 0.5, z + 1.9) if k % 2 else (z + 1.9, z + 0.5)
        parts.append(
            tube(_GANTRY_STEEL, [(-0.2, y, ends[0]), (-0.2, y + 1.4, ends[1])], 0.045, 5, caps=False)
        )
    for side, yaw, names in ((1.0, 0.0, (2, 5, 7)), (-1.0, np.pi, (3, 4, 6))):
        span = reach[0] if side > 0 else reach[1]
        for k, share in enumerate((0.38, 0.72) if span > 2.4 * BOARD_M[0] else (0.55,)):
            at = (0.12 * elementary.cos(yaw) - 0.2, side * share * span, z + 1.2)
            parts.append(placed(direction_board(names[k], names[k + 1]), at, yaw))
    T = poses([(*centre, 0.0)], heading)
    return copies(merge(parts), T, 0)


def _reach(centre: Array, direction: Array, paved: Area) -> float:
    """Distance [m] along a direction at which nothing paved is near any more."""
    away_m = np.arange(3.0, LONGEST_GANTRY_M, 0.5)
    distance = shapely.distance(paved, shapely.points(centre + away_m[:, None] * direction))
    free = np.flatnonzero(distance > POST_CLEAR_M)
    return float(away_m[free[0]]) if len(free) else LONGEST_GANTRY_M


def pier(feature: Feature, _: Area, floor: HeightOf) -> Mesh:
    """Wooden deck on piles that leads from the shore along the heading, with rails, a lamp and benches."""
    length = feature.size[0] if feature.size else 60.0
    width = PIER_WIDTH_M if length >= SMALL_PIER_M else 0.5 * PIER_WIDTH_M
    heading = np.radians(feature.heading_deg)
    ahead = np.array([elementary.cos(heading), elementary.sin(heading)])
    shore = np.array(feature.position) - 0.5 * length * ahead
    top = float(floor(shore[None])[0]) + 0.12
    parts = [box(_WOOD, (length + 2.0, width, 0.08), (-1.0, 0.0, -0.04))]
    parts += [box(_WOOD, (length, 0.22, 0.3), (0.0, y, -0.23)) for y in (-0.42 * width, 0.0, 0.42 * width)]
    joints = np.arange(-length / 2, length / 2, 0.6)
    dark = Look(Material.WOOD, Tag.STATIC, (90, 82, 72))
    parts += [box(dark, (0.02, width, 0.004), (x, 0.0, 0.0)) for x in joints]
    for x in np.arange(-length / 2 + 3.0, length / 2 + 0.1, 6.0):
        parts += [tube(dark, [(x, y, -7.0), (x, y, 0.02)], 0.17, 8) for y in (-0.44 * width, 0.44 * width)]
    parts += _pier_rails(length, width)
    if width >= PIER_WIDTH_M:
        parts += [
            placed(lamp(4.5, 0.7), (x, 0.0, 0.0), np.pi / 2)
            for x in np.arange(-length / 2 + 12, length / 2, 18)
        ]
        parts += [
            placed(bench(), (x, 0.3 * width, 0.0), -np.pi / 2)
            for x in np.arange(-length / 2 + 8, length / 2, 14)
        ]
    end = length / 2 - 0.5
    parts += [placed(bollard(), (end, y, 0.0)) for y in (-0.3 * width, 0.3 * width)]
    return copies(merge(parts), poses([(*feature.position, top)], heading), 0)


def _pier_rails(length: float, width: float) -> list[Mesh]:
    parts = []
    for y in (-0.48 * width, 0.48 * width):
        for z in (0.55, 1.0):
            parts.append(box(_WOOD, (length - 4.0, 0.06, 0.1), (1.0, y, z)))
        parts += [
            box(_WOOD, (0.1, 0.1, 1.05), (x, y, 0.5)) for x in np.arange(-length / 2 + 3, length / 2 - 1, 2.0)
        ]
    return parts
