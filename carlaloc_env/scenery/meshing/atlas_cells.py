"""Texture coordinates of materials whose texture is a sheet of different pictures."""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.assets.texture_atlas import GRID, MARGIN
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import MATERIALS, Material


def cell_uv(material: Material, cell: NDArray[np.integer], aspect: float = 1.0) -> Array:
    """Texture coordinates [m] (N, 4, 2) that show one picture on each upright quad.

    Args:
        material: One of those in `assets.texture_atlas.GRID`.
        cell: Picture of each quad, counted from the lower left to the right, then upwards; any whole number,
            taken modulo the number of pictures, shape (N,).
        aspect: Width over height of quads on which only a middle strip of the picture is shown.
    """
    columns, rows = GRID[material]
    width, height = MATERIALS[material].tile_m / columns, MATERIALS[material].tile_m / rows
    row, column = np.divmod(np.asarray(cell) % (columns * rows), columns)
    cut = (1.0 - 1.0 / aspect) / 2 if aspect > 1.0 else 0.0
    edge = MARGIN * min(width, height)
    u0, u1 = column * width + edge, (column + 1) * width - edge
    v0, v1 = (row + cut) * height + edge, (row + 1 - cut) * height - edge
    corners = [np.stack([u, v], axis=-1) for u, v in ((u0, v0), (u1, v0), (u1, v1), (u0, v1))]
    result: Array = np.stack(corners, axis=1)
    return result
