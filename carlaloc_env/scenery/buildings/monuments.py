"""Things that stand on squares: an obelisk and a fountain."""

from itertools import pairwise

import numpy as np

from carlaloc_env.assets.primitives import Look, lathe
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.buildings.walls import around
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder, box_quads

_STONE = (235, 228, 210)


def monument() -> Mesh:
    """An obelisk on steps, 13 m high."""
    out = MeshBuilder()
    steps = [(4.0, 0.35), (3.2, 0.7), (2.4, 1.05)]
    low = [(-half, -half, height - 0.35 if height > 0.4 else -0.5) for half, height in steps]
    high = [(half, half, height) for half, height in steps]
    out.quads(box_quads(low, high), material=Material.ASHLAR, tag=Tag.OTHER, colour=_STONE)
    plinth = box_quads(
        [(-1.3, -1.3, 1.05), (-1.5, -1.5, 3.1)], [(1.3, 1.3, 3.1), (1.5, 1.5, 3.45)], bottom=True
    )
    out.quads(plinth, material=Material.ASHLAR, tag=Tag.OTHER, colour=(215, 208, 190))
    ring = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], dtype=np.float64)
    levels = [(0.95, 3.45), (0.62, 11.8), (0.02, 13.0)]
    for (a, z0), (b, z1) in pairwise(levels):
        base = np.column_stack([ring * a, np.full(4, z0)])
        head = np.column_stack([ring * b, np.full(4, z1)])
        faces = np.stack([base, np.roll(base, -1, 0), np.roll(head, -1, 0), head], axis=1)
        out.quads(faces, material=Material.ASHLAR, tag=Tag.OTHER, colour=_STONE)
    for wall in around(2.6, 2.6):
        plate = wall.front(0.5, 2.1, 1.5, 2.6, 0.02) - np.array([1.3, 1.3, 0.0])
        out.quads(plate, material=Material.METAL_PAINTED, tag=Tag.OTHER, colour=(70, 55, 25))
    return out.build()


def fountain() -> Mesh:
    """Two bowls over a round basin, 4.2 m high."""
    stone = Look(Material.CONCRETE, Tag.STATIC, (250, 244, 228))
    water = Look(Material.WATER, Tag.WATER)
    basin = [(4.2, -0.4), (4.2, 0.55), (4.05, 0.62), (3.85, 0.62), (3.75, 0.5), (3.75, 0.15), (0.1, 0.15)]
    stem = [(0.9, 0.1), (0.5, 0.5), (0.32, 1.4), (0.4, 1.8)]
    lower = [(1.75, 2.15), (1.8, 2.3), (1.65, 2.25), (0.25, 2.0)]
    upper = [(0.3, 2.0), (0.18, 2.6), (0.22, 3.2), (0.95, 3.45), (1.0, 3.55), (0.9, 3.5), (0.12, 3.35)]
    tip = [(0.14, 3.3), (0.1, 3.8), (0.2, 3.95), (0.16, 4.1), (0.02, 4.2)]
    pools = [
        lathe(water, [(r, z - 0.02), (r - 0.02, z), (0.05, z)], 28) for r, z in ((3.8, 0.42), (1.6, 2.2))
    ]
    return merge([*(lathe(stone, line, 28) for line in (basin, stem + lower, upper, tip)), *pools])
