"""Covers and repairs as cameras see them: their sizes, materials and shapes."""

import numpy as np

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder

PATCH_M = 0.002
"""Height of repairs above the road [m]; paint lies higher."""
SEAL_M, SEAL_WIDTH_M = 0.0016, 0.055
"""Height and width of the bitumen that seals the edges of a repair [m]."""
COVER_M = 0.0025
"""Height of covers and drains above the road [m]."""
COVER_RADIUS_M, COLLAR_M = 0.33, 1.1
"""Radius of a cover, and edge of the square that some are set in [m]."""
COLLARS, COLLAR_GREY = 0.3, (150.0, 190.0)
"""Share of covers that are set in a square of younger asphalt, and its brightness."""
SQUARE = 0.886
"""Half the side of a square over the radius of a disc of the same area."""
REPAIRS: tuple[tuple[Material, tuple[float, float], float, float], ...] = (
    (Material.ASPHALT, (150.0, 205.0), 0.65, 0.3),
    (Material.ASPHALT_OLD, (200.0, 235.0), 0.35, 0.6),
)
"""Materials of repairs: brightness, share of all repairs, share of these with sealed edges."""


def repair_surface(draw: np.random.Generator, only: Material | None = None) -> tuple[Material, float, bool]:
    """Material of a repair (`only` where given), its brightness 0–255, and whether its edges are sealed."""
    kind = int(draw.choice(len(REPAIRS), p=[share for _, _, share, _ in REPAIRS]))
    material, (low, high), _, sealed = REPAIRS[kind]
    return only or material, float(draw.uniform(low, high)), bool(draw.random() < sealed)


def cover_rings() -> Array:
    """Twelve points each of a cover's frame, lid and boss, forward and left of its middle [m], (36, 2)."""
    angle = np.tile(np.arange(12) * (np.pi / 6), 3)
    radius = np.repeat([COVER_RADIUS_M, COVER_RADIUS_M - 0.06, 0.12], 12)
    # Angles run from left to forward: clockwise seen from above.
    return np.stack([radius * elementary.sin(angle), radius * elementary.cos(angle)], axis=-1)


def lay_cover(out: MeshBuilder, rings: Array) -> None:
    """A cover: its frame and the boss in its middle are worn blank; points (36, 3) of `cover_rings`."""
    fan = np.stack([np.zeros(10, int), np.arange(1, 11), np.arange(2, 12)], axis=-1)
    for k, grey in enumerate((40.0, 20.0, 28.0)):
        ring = rings[12 * k : 12 * k + 12] + np.array([0.0, 0.0, COVER_M + 0.0004 * k])
        out.triangles(
            ring, fan[:, ::-1], material=Material.PLAIN, tag=Tag.ROAD, colour=(grey, 0.97 * grey, 0.93 * grey)
        )
