"""Semantic tags of CARLA since 0.9.14 and one of snow, and their colours.

The numbers are those of CARLA's ``Docs/ref_sensors.md`` and ``CityScapesPalette.h``. Falling snow, which only
LiDARs see as points, is ours.
"""

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray


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
    SNOW = 29


PALETTE_RGB: NDArray[np.uint8] = np.array(
    [
        (0, 0, 0), (128, 64, 128), (244, 35, 232), (70, 70, 70), (102, 102, 156),
        (190, 153, 153), (153, 153, 153), (250, 170, 30), (220, 220, 0), (107, 142, 35),
        (152, 251, 152), (70, 130, 180), (220, 20, 60), (255, 0, 0), (0, 0, 142),
        (0, 0, 70), (0, 60, 100), (0, 80, 100), (0, 0, 230), (119, 11, 32),
        (110, 190, 160), (170, 120, 50), (55, 90, 80), (45, 60, 150), (157, 234, 50),
        (81, 0, 81), (150, 100, 100), (230, 150, 140), (180, 165, 180),
        (200, 230, 255),
    ],
    dtype=np.uint8,
)  # fmt: skip
"""Colour of each tag, sRGB 0–255, shape (30, 3)."""

DYNAMIC_TAGS = frozenset(
    {Tag.PEDESTRIAN, Tag.RIDER, Tag.CAR, Tag.TRUCK, Tag.BUS, Tag.TRAIN, Tag.MOTORCYCLE, Tag.BICYCLE}
)
"""Tags of things that move by themselves."""


def colourise(tags: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """sRGB picture (..., 3) of semantic tags (...)."""
    result: NDArray[np.uint8] = PALETTE_RGB[np.minimum(tags, len(PALETTE_RGB) - 1)]
    return result
