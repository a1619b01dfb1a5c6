"""Jetties: wooden decks on piles that lead from a shore into the water."""

import numpy as np

from carlaloc_env.assets.primitives import Look, box, placed, tube
from carlaloc_env.assets.street_furniture import bench, bollard, lamp
from carlaloc_env.core import elementary
from carlaloc_env.core.areas import Area
from carlaloc_env.map.config import Feature
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.height_fields import HeightOf
from carlaloc_env.scenery.meshing.props import copies, poses

JETTY_WIDTH_M, SMALL_JETTY_M = 6.0, 40.0
"""Width of a jetty [m]; shorter ones are half as wide."""
_WOOD = Look(Material.WOOD, Tag.STATIC, (200, 190, 175))


def jetty(feature: Feature, _: Area, floor: HeightOf) -> Mesh:
    """Wooden deck on piles that leads from the shore along the heading, with rails, a lamp and benches."""
    length = feature.size[0] if feature.size else 60.0
    width = JETTY_WIDTH_M if length >= SMALL_JETTY_M else 0.5 * JETTY_WIDTH_M
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
    parts += _jetty_rails(length, width)
    if width >= JETTY_WIDTH_M:
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


def _jetty_rails(length: float, width: float) -> list[Mesh]:
    parts = []
    for y in (-0.48 * width, 0.48 * width):
        for z in (0.55, 1.0):
            parts.append(box(_WOOD, (length - 4.0, 0.06, 0.1), (1.0, y, z)))
        parts += [
            box(_WOOD, (0.1, 0.1, 1.05), (x, y, 0.5)) for x in np.arange(-length / 2 + 3, length / 2 - 1, 2.0)
        ]
    return parts
