"""Number plates: texts of the vehicles' plates, and the place of each in the texture `Material.PLATE`."""

import numpy as np

from carlaloc_env.assets.texture_atlas import Rect
from carlaloc_env.scene.materials import MATERIALS, Material

PLATE_COLUMNS, PLATE_ROWS = 4, 16
"""Cells of the texture, each four times as wide as high; plate 0 lies at the lower left."""
PLATES = PLATE_COLUMNS * PLATE_ROWS
"""Number of different plates."""
PLATE_SIZE_M = (0.52, 0.115)
"""Width and height of a car's plate [m]."""
_LETTERS = "ABCDEFGHJKLMNPRSTUVWXYZ"
_TOWNS = ("CL", "LO", "CA", "MK", "TB", "RW", "PX", "HN")
_MARGIN = 1.0 / 48.0


def plate_text(index: int) -> str:
    """Letters and digits of a plate; no two of the `PLATES` plates read alike."""
    k = index % PLATES
    # Steps that share no factor with what they are counted in visit every value once.
    first, second = _LETTERS[(7 * k + 3) % 23], _LETTERS[(11 * k + 5 * (k // 23)) % 23]
    return f"{_TOWNS[k % len(_TOWNS)]} {first}{second} {100 + (k * 353 + 47) % 900}"


def plate_of(actor_id: np.ndarray) -> np.ndarray:
    """Number of the plate that each actor wears, by its instance id, shape (N,)."""
    mixed = actor_id.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    return (mixed >> np.uint64(40)).astype(np.int64) % PLATES


def plate_uv(index: int) -> Rect:
    """Texture rectangle (u0, v0, u1, v1) of a plate [m], v upwards."""
    row, column = divmod(index % PLATES, PLATE_COLUMNS)
    tile = MATERIALS[Material.PLATE].tile_m
    width, height = tile / PLATE_COLUMNS, tile / PLATE_ROWS
    edge = _MARGIN * height
    return column * width + edge, row * height + edge, (column + 1) * width - edge, (row + 1) * height - edge
