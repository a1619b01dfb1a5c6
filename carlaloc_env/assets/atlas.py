"""Which cell of an atlas texture holds which picture, and its texture coordinates.

An atlas layer is a square of `tile_m` metres cut into equal cells; cell 0 lies at the lower left
(u = v = 0), cells count to the right, then upwards. v grows upwards on a wall.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.errors import ConfigError, unknown_name
from carlaloc_env.materials import MATERIALS, Material

Rect = tuple[float, float, float, float]

GRID: dict[Material, int] = {
    Material.WINDOW: 4,
    Material.SHOP_FRONT: 2,
    Material.DOOR: 2,
    Material.POSTER: 4,
    Material.SIGN: 4,
}
"""Cells along one side of each atlas layer."""

_MARGIN = 1.0 / 64.0
"""Share of a cell left out at each edge, so that coarse mip levels do not bleed."""


class SignCell(IntEnum):
    """Cells of `Material.SIGN`."""

    STOP = 0
    YIELD = 1
    SPEED_30 = 2
    SPEED_40 = 3
    SPEED_50 = 4
    SPEED_60 = 5
    SPEED_90 = 6
    NO_ENTRY = 7
    ONE_WAY = 8
    CROSSING = 9
    PARKING = 10
    BUS_STOP = 11
    STREET_A = 12
    STREET_B = 13
    PLATE = 14
    BACK = 15


class WindowCell(IntEnum):
    """Cells of `Material.WINDOW`: sashes with different blinds, curtains and rooms."""

    PLAIN = 0
    BLIND_LOW = 1
    BLIND_HALF = 2
    BLIND_FULL = 3
    CURTAIN_WHITE = 4
    CURTAIN_RED = 5
    CURTAIN_GREEN = 6
    NET = 7
    SLATS = 8
    SLATS_HALF = 9
    PLANT = 10
    LAMP = 11
    SHELF = 12
    OPEN_SASH = 13
    DARK = 14
    BRIGHT = 15


class ShopCell(IntEnum):
    """Cells of `Material.SHOP_FRONT`."""

    CAFE = 0
    BOOKS = 1
    GROCER = 2
    FASHION = 3


class DoorCell(IntEnum):
    """Cells of `Material.DOOR`."""

    PANELLED = 0
    GLAZED = 1
    STEEL = 2
    GARAGE = 3


class PosterCell(IntEnum):
    """Cells of `Material.POSTER`: bills with lettering and simple pictures."""

    OPERA = 0
    CIRCUS = 1
    COFFEE = 2
    MUSEUM = 3
    JAZZ = 4
    MARATHON = 5
    CINEMA = 6
    TRAVEL = 7
    BANK = 8
    GALLERY = 9
    FESTIVAL = 10
    MARKET = 11
    RADIO = 12
    ZOO = 13
    THEATRE = 14
    SALE = 15


STREET_NAMES = (
    "MAIN ST",
    "OAK AVE",
    "HARBOUR RD",
    "STATION ST",
    "PARK LANE",
    "MILL ROAD",
    "CHURCH ST",
    "LAKE VIEW",
)
"""Names on the street-name plates: four strips in `STREET_A`, four in `STREET_B`, from the bottom up."""


def street_name_uv(index: int) -> Rect:
    """Texture rectangle of one street-name plate (four times as wide as high) [m]."""
    index = int(index) % len(STREET_NAMES)
    u0, v0, u1, v1 = atlas_uv(Material.SIGN, SignCell.STREET_A if index < 4 else SignCell.STREET_B)
    step = (v1 - v0) / 4
    return u0, v0 + (index % 4) * step, u1, v0 + (index % 4 + 1) * step


def atlas_cells(material: Material) -> int:
    """Number of cells of an atlas material.

    Raises:
        ConfigError: the material's texture is not an atlas.
    """
    if material not in GRID:
        raise ConfigError(unknown_name("atlas texture", material.name, (m.name for m in GRID)))
    return GRID[material] ** 2


def atlas_uv(material: Material, cell: int) -> Rect:
    """Texture rectangle (u0, v0, u1, v1) of a cell [m], v upwards.

    Args:
        material: `WINDOW`, `SHOP_FRONT`, `DOOR`, `POSTER` or `SIGN`.
        cell: Number of the cell; taken modulo the number of cells.

    Raises:
        ConfigError: the material's texture is not an atlas.
    """
    cell = int(cell) % atlas_cells(material)
    side = GRID[material]
    size = MATERIALS[material].tile_m / side
    row, column = divmod(cell, side)
    edge = _MARGIN * size
    return column * size + edge, row * size + edge, (column + 1) * size - edge, (row + 1) * size - edge


def cell_corners(rect: Rect) -> NDArray[np.float64]:
    """Corners of a texture rectangle, anticlockwise from the lower left, shape (4, 2) [m]."""
    u0, v0, u1, v1 = rect
    return np.array([(u0, v0), (u1, v0), (u1, v1), (u0, v1)])
