"""Billboards of the wayside, with a picture on both faces."""

import numpy as np

from carlaloc_env.assets.primitives import Look, box, panel, placed, tube
from carlaloc_env.assets.texture_atlas import atlas_uv, cell_corners
from carlaloc_env.core import elementary
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag


def billboard(
    picture: int = 0, *, width_m: float = 7.2, height_m: float = 3.6, bottom_m: float = 3.4
) -> Mesh:
    """Board on two posts with a catwalk and lamps, facing +x; the back shows the next picture.

    Args:
        picture: Cell of `Material.BILLBOARD`, any whole number.
        width_m: Width of the picture [m].
        height_m: Height of the picture [m].
        bottom_m: Height of its lower edge [m].
    """
    steel = Look(Material.METAL_GALVANISED, Tag.STATIC, (190, 190, 190))
    dark = Look(Material.METAL_PAINTED, Tag.STATIC, (36, 40, 42))
    frame = Look(Material.METAL_PAINTED, Tag.STATIC, (60, 64, 60))
    middle = bottom_m + 0.5 * height_m
    parts = [
        tube(steel, [(0.0, y, -0.4), (0.0, y, bottom_m + height_m - 0.2)], 0.16, 8)
        for y in (-0.27 * width_m, 0.27 * width_m)
    ]
    w, h = 0.5 * width_m, 0.5 * height_m
    corners = [(0.0, -w, -h), (0.0, w, -h), (0.0, w, h), (0.0, -w, h)]
    for turn, cell in ((0.0, picture), (np.pi, picture + 3)):
        uv = cell_corners(atlas_uv(Material.BILLBOARD, cell))
        board = panel(Look(Material.BILLBOARD, Tag.STATIC), corners, uv, 0.06, frame)
        spot = (0.24 * elementary.cos(turn), 0.0, middle)
        parts += [placed(mesh, spot, turn) for mesh in board]
    for z in (bottom_m - 0.07, bottom_m + height_m + 0.07):
        parts.append(box(frame, (0.56, width_m + 0.3, 0.14), (0.0, 0.0, z)))
    for y in (-w - 0.07, w + 0.07):
        parts.append(box(frame, (0.56, 0.14, height_m), (0.0, y, middle)))
    parts.append(box(dark, (0.7, width_m, 0.05), (0.62, 0.0, bottom_m - 0.25)))
    for y in (-0.5 * w, 0.5 * w):
        parts.append(tube(dark, [(0.2, y, bottom_m - 0.2), (1.1, y, bottom_m - 0.1)], 0.03, 5))
        parts.append(box(dark, (0.22, 0.5, 0.12), (1.1, y, bottom_m - 0.05)))
    return merge(parts)
