"""Features that belong to roads and shores: sign gantries and piers."""

from __future__ import annotations

import numpy as np
import shapely

from carlaloc_env.assets.primitives import Look, box, placed, tube
from carlaloc_env.assets.signs import BOARD_M, CLEAR_M, direction_board
from carlaloc_env.assets.street_furniture import bench, bollard, lamp
from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material, Tag
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.town.config import Feature
from carlaloc_env.town.ground.height_fields import HeightOf
from carlaloc_env.town.meshing.polygons import Area
from carlaloc_env.town.meshing.prop_copies import copies, poses

LONGEST_GANTRY_M = 45.0
"""Farthest that a gantry reaches to each side of its place [m]."""
POST_CLEAR_M = 1.0
"""Distance of its posts from everything paved [m]."""
PIER_WIDTH_M, SMALL_PIER_M = 6.0, 40.0
"""Width of a pier [m]; shorter ones are half as wide."""
_STEEL = Look(Material.METAL_GALVANISED, Tag.POLE, (195, 198, 200))
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
        parts.append(tube(_STEEL, [(-0.2, y, base - 0.3), (-0.2, y, z + 2.2)], [0.26, 0.2], 12))
    for dz in (0.5, 1.9):
        length = reach[0] + reach[1]
        parts.append(box(_STEEL, (0.16, length, 0.16), (-0.2, 0.5 * (reach[0] - reach[1]), z + dz)))
    for k, y in enumerate(np.arange(-reach[1] + 0.5, reach[0] - 1.0, 1.4)):
        ends = (z + 0.5, z + 1.9) if k % 2 else (z + 1.9, z + 0.5)
        parts.append(tube(_STEEL, [(-0.2, y, ends[0]), (-0.2, y + 1.4, ends[1])], 0.045, 5, caps=False))
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
