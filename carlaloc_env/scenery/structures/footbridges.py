"""Footbridges over wide roads: a deck between two stairs, with piers where the roads below leave room."""

import itertools
from collections.abc import Callable

import numpy as np
import shapely

from carlaloc_env.assets.primitives import Look, box, tube
from carlaloc_env.core import elementary
from carlaloc_env.core.areas import Area
from carlaloc_env.core.array_types import Array
from carlaloc_env.map.config import Feature
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.height_fields import HeightOf
from carlaloc_env.scenery.meshing.props import copies, poses

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
    bases_m = a + np.linspace(0.0, 1.0, count)[:, None] * (b - a)
    parts = [box(_STEEL, (0.08, 0.08, RAILING_M), foot + 0.5 * RAILING_M * up) for foot in bases_m]
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
