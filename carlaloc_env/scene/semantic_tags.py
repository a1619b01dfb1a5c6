"""Semantic tags of CARLA ≥ 0.9.14, of CARLA ≤ 0.9.13, and the colours of both.

Source of both tables: CARLA ``Docs/ref_sensors.md`` and ``CityScapesPalette.h``.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.errors import ConfigError, unknown_name


class Tag(IntEnum):
    """Semantic tag of a surface (CARLA ≥ 0.9.14)."""

    UNLABELED = 0
    ROAD = 1
    SIDEWALK = 2
    BUILDING = 3
    WALL = 4
    FENCE = 5
    POLE = 6
    TRAFFIC_LIGHT = 7
    TRAFFIC_SIGN = 8
    VEGETATION = 9
    TERRAIN = 10
    SKY = 11
    PEDESTRIAN = 12
    RIDER = 13
    CAR = 14
    TRUCK = 15
    BUS = 16
    TRAIN = 17
    MOTORCYCLE = 18
    BICYCLE = 19
    STATIC = 20
    DYNAMIC = 21
    OTHER = 22
    WATER = 23
    ROAD_LINE = 24
    GROUND = 25
    BRIDGE = 26
    RAIL_TRACK = 27
    GUARD_RAIL = 28


PALETTE_RGB: NDArray[np.uint8] = np.array(
    [
        (0, 0, 0), (128, 64, 128), (244, 35, 232), (70, 70, 70), (102, 102, 156),
        (190, 153, 153), (153, 153, 153), (250, 170, 30), (220, 220, 0), (107, 142, 35),
        (152, 251, 152), (70, 130, 180), (220, 20, 60), (255, 0, 0), (0, 0, 142),
        (0, 0, 70), (0, 60, 100), (0, 80, 100), (0, 0, 230), (119, 11, 32),
        (110, 190, 160), (170, 120, 50), (55, 90, 80), (45, 60, 150), (157, 234, 50),
        (81, 0, 81), (150, 100, 100), (230, 150, 140), (180, 165, 180),
    ],
    dtype=np.uint8,
)  # fmt: skip
"""Colour of each tag, sRGB 0–255, shape (29, 3)."""

TO_LEGACY: NDArray[np.uint8] = np.array(
    [0, 7, 8, 1, 11, 2, 5, 18, 12, 9, 22, 13, 4, 4, 10, 10, 10, 10, 10, 10, 19, 20, 3, 21, 6, 14, 15, 16, 17],
    dtype=np.uint8,
)
"""Tag of CARLA ≤ 0.9.13 for each tag, shape (29,); riders count as pedestrians there."""

LEGACY_PALETTE_RGB: NDArray[np.uint8] = np.array(
    [
        (0, 0, 0), (70, 70, 70), (100, 40, 40), (55, 90, 80), (220, 20, 60), (153, 153, 153),
        (157, 234, 50), (128, 64, 128), (244, 35, 232), (107, 142, 35), (0, 0, 142), (102, 102, 156),
        (220, 220, 0), (70, 130, 180), (81, 0, 81), (150, 100, 100), (230, 150, 140), (180, 165, 180),
        (250, 170, 30), (110, 190, 160), (170, 120, 50), (45, 60, 150), (145, 170, 100),
    ],
    dtype=np.uint8,
)  # fmt: skip
"""Colour of each tag of CARLA ≤ 0.9.13, sRGB 0–255, shape (23, 3)."""

TAG_TABLES = ("0.9.14", "0.9.13")
"""Tables that sensors can report tags in, named by the CARLA version that began or ended with them."""

DYNAMIC_TAGS = frozenset(
    {Tag.PEDESTRIAN, Tag.RIDER, Tag.CAR, Tag.TRUCK, Tag.BUS, Tag.TRAIN, Tag.MOTORCYCLE, Tag.BICYCLE}
)
"""Tags of things that move by themselves."""


def tags_in(table: str, tags: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Tags of this module's `Tag` as a table of `TAG_TABLES` numbers them, same shape.

    Raises:
        ConfigError: There is no such table.
    """
    if table not in TAG_TABLES:
        raise ConfigError(unknown_name("tag table", table, TAG_TABLES))
    if table == TAG_TABLES[0]:
        return tags
    legacy: NDArray[np.uint8] = TO_LEGACY[np.minimum(tags, len(TO_LEGACY) - 1)]
    return legacy


def colourise(tags: NDArray[np.uint8], table: str = TAG_TABLES[0]) -> NDArray[np.uint8]:
    """sRGB picture (..., 3) of semantic tags (...) numbered as in one of `TAG_TABLES`."""
    palette = PALETTE_RGB if table == TAG_TABLES[0] else LEGACY_PALETTE_RGB
    result: NDArray[np.uint8] = palette[np.minimum(tags, len(palette) - 1)]
    return result
