"""Sign gantries over whole roads."""

import numpy as np
import shapely

from carlaloc_env.assets.direction_signs import BOARD_M, CLEAR_M, direction_board
from carlaloc_env.assets.primitives import Look, box, placed, tube
from carlaloc_env.core import elementary
from carlaloc_env.core.areas import Area
from carlaloc_env.core.array_types import Array
from carlaloc_env.map.config import Feature
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.height_fields import HeightOf
from carlaloc_env.scenery.meshing.props import copies, poses

LONGEST_GANTRY_M = 45.0
"""Farthest that a gantry reaches to each side of its place [m]."""
POST_CLEAR_M = 1.0
"""Distance of its posts from everything paved [m]."""
_GANTRY_STEEL = Look(Material.METAL_GALVANISED, Tag.POLE, (195, 198, 200))


def gantry(feature: Feature, paved: Area, floor: HeightOf) -> Mesh:
    """Gantry over a whole road: boards towards both directions; its front looks along the heading."""
    centre, heading = np.array(feature.position), np.radians(feature.heading_deg)
    # Drivers who see the front drive against the heading and keep to the right.
    right = np.array([-elementary.sin(heading), elementary.cos(heading)])
    shapely.prepare(paved)
    reach = [_reach(centre, sign * right, paved) for sign in (1.0, -1.0)]
    bases_m = np.array([centre + reach[0] * right, centre - reach[1] * right])
    across = centre + np.linspace(-reach[1], reach[0], 15)[:, None] * right
    low = float(floor(across).max())
    z = low + CLEAR_M + 0.3
    parts = []
    for y, foot in ((reach[0], bases_m[0]), (-reach[1], bases_m[1])):
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
