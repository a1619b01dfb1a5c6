"""Cells of the atlas textures: the picture that each holds, and its texture coordinates.

An atlas layer is a square of `tile_m` metres cut into equal cells; cell 0 lies at the lower left
(u = v = 0), cells count to the right, then upwards. v grows upwards on a wall.
"""

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.scene.materials import MATERIALS, Material

Rect = tuple[float, float, float, float]
"""Left, lower, right and upper border."""

GRID: dict[Material, tuple[int, int]] = {
    Material.WINDOW: (4, 4),
    Material.SHOP_FRONT: (2, 2),
    Material.DOOR: (2, 2),
    Material.POSTER: (4, 4),
    Material.SIGN: (4, 4),
    Material.SHOP_SIGN: (2, 16),
    Material.BILLBOARD: (2, 4),
    Material.WINDOW_WIDE: (2, 4),
    Material.SHOP_FRONT_B: (2, 2),
}
"""Columns and rows of cells of each atlas layer."""

MARGIN = 1.0 / 64.0
"""Share of a cell left out at each edge, so that coarse mip levels do not bleed."""


SignCell = IntEnum(
    "SignCell",
    "STOP YIELD SPEED_30 SPEED_40 SPEED_50 SPEED_60 SPEED_90 NO_ENTRY ONE_WAY CROSSING PARKING "
    "BUS_STOP STREET_A STREET_B PLATE BACK",
    start=0,
)
"""Cells of `Material.SIGN`."""


WindowCell = IntEnum(
    "WindowCell",
    "PLAIN BLIND_LOW BLIND_HALF BLIND_FULL CURTAIN_WHITE CURTAIN_RED CURTAIN_GREEN NET SLATS "
    "SLATS_HALF PLANT LAMP SHELF OPEN_SASH DARK BRIGHT",
    start=0,
)
"""Cells of `Material.WINDOW`: sashes with different blinds, curtains and rooms."""


ShopCell = IntEnum("ShopCell", "CAFE BOOKS GROCER FASHION", start=0)
"""Cells of `Material.SHOP_FRONT`."""


ShopBCell = IntEnum("ShopBCell", "BAKERY PHARMACY BARBER ELECTRO", start=0)
"""Cells of `Material.SHOP_FRONT_B`."""


WideWindowCell = IntEnum(
    "WideWindowCell", "OFFICE BLINDS HALF_BLINDS CURTAINS DARK LIT THREE_SASH PLANTS", start=0
)
"""Cells of `Material.WINDOW_WIDE`: windows about twice as wide as high."""


DoorCell = IntEnum("DoorCell", "PANELLED GLAZED STEEL GARAGE", start=0)
"""Cells of `Material.DOOR`."""


PosterCell = IntEnum(
    "PosterCell",
    "OPERA CIRCUS COFFEE MUSEUM JAZZ MARATHON CINEMA TRAVEL BANK GALLERY FESTIVAL MARKET RADIO "
    "ZOO THEATRE SALE",
    start=0,
)
"""Cells of `Material.POSTER`: bills with lettering and simple pictures."""


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


SHOP_NAMES: tuple[tuple[str, str], ...] = (
    ("BAKERY ROSE", "fresh bread"), ("CITY PHARMACY", "day and night"), ("ANTON'S", "hair & shave"),
    ("PIZZA ROMA", "to take away"), ("HARDWARE", "tools and paint"), ("FLOWERS", "by Ella"),
    ("LUCKY NOODLE", "lunch 11-3"), ("OPTIK BERG", "eyes tested"), ("THE RED LION", "ales & food"),
    ("SHOE CLINIC", "keys cut"), ("BIKE WORKS", "repairs"), ("CORNER DELI", "est. 1962"),
    ("PHOTO LAB", "prints today"), ("MUSIC BOX", "vinyl & CD"), ("TAILOR", "M. Fischer"),
    ("GREEN GROCER", "local fruit"), ("LAUNDRY", "open 6-22"), ("HOTEL ASTRA", "rooms free"),
    ("TEA HOUSE", "since 1921"), ("GOLD & TIME", "watches"), ("BUTCHER", "Hansen & son"),
    ("TOY LAND", "games"), ("BANK", "cash point"), ("PET CORNER", "feed & care"), ("TATTOO 13", "walk in"),
    ("KEBAB STAR", "grill"), ("INSURANCE", "ask us"), ("PAPER & INK", "stationery"), ("SUSHI GO", "bar"),
    ("DENTIST", "2nd floor"), ("TYRES PLUS", "fitted now"), ("MOBILE FIX", "in 30 min"),
)  # fmt: skip
"""Name and second line of each shop sign in `Material.SHOP_SIGN`, from the bottom up, two in a row."""

BILLBOARDS: tuple[tuple[str, str, tuple[int, int, int], tuple[int, int, int], str], ...] = (
    ("DRIVE ON", "the new Meridian", (24, 40, 72), (244, 236, 214), "car"),
    ("BIG BITE", "next exit 2 km", (246, 196, 40), (150, 22, 20), "burger"),
    ("GO WEST", "trains from 19", (236, 232, 220), (20, 90, 130), "hills"),
    ("FM 101", "all hits, no ads", (30, 28, 34), (250, 120, 40), "dots"),
    ("LIVE HIGH", "flats for sale", (220, 228, 234), (30, 60, 90), "tower"),
    ("FRESH MILK", "from your valley", (60, 130, 70), (250, 250, 240), "dots"),
    ("SAFE HANDS", "insurance", (150, 26, 44), (248, 240, 226), "car"),
    ("SEA VIEW", "camping by the lake", (250, 214, 120), (16, 70, 100), "hills"),
)
"""Headline, line below, ground, ink and picture of each billboard, from the bottom up, two in a row."""


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
    columns, rows = GRID[material]
    return columns * rows


def atlas_uv(material: Material, cell: int) -> Rect:
    """Texture rectangle (u0, v0, u1, v1) of a cell [m], v upwards.

    Args:
        material: A key of `GRID`.
        cell: Number of the cell; taken modulo the number of cells.

    Raises:
        ConfigError: the material's texture is not an atlas.
    """
    cell = int(cell) % atlas_cells(material)
    columns, rows = GRID[material]
    tile = MATERIALS[material].tile_m
    width, height = tile / columns, tile / rows
    row, column = divmod(cell, columns)
    edge = MARGIN * min(width, height)
    return column * width + edge, row * height + edge, (column + 1) * width - edge, (row + 1) * height - edge


def cell_corners(rect: Rect) -> NDArray[np.float64]:
    """Corners of a texture rectangle, anticlockwise from the lower left, shape (4, 2) [m]."""
    u0, v0, u1, v1 = rect
    return np.array([(u0, v0), (u1, v0), (u1, v1), (u0, v1)])
