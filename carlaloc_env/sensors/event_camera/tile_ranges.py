"""The lowest and highest value of a picture in each of its tiles, which tell what a pixel can meet there."""

from __future__ import annotations

from typing import Any

import numpy as np

from carlaloc_env.core.array_types import F32
from carlaloc_env.core.jit import compiled, inlined, over_bands
from carlaloc_env.sensors.imaging.motion_field import TILE_PX


def tile_ranges(image: F32) -> F32:
    """Lowest and highest value in each tile and one pixel around it, shape (h, w, 2)."""
    rows, columns = (-(-n // TILE_PX) for n in image.shape)
    ranges = np.empty((rows, columns, 2), np.float32)

    def fill(first: int, end: int) -> None:
        _fill_ranges(image, np.empty((2, image.shape[1]), np.float32), ranges, first, end)

    over_bands(fill, rows)
    return ranges


@compiled
def _fill_ranges(image: Any, across: Any, ranges: Any, first: int, end: int) -> None:
    """Fill in rows of tiles; `across`: room for the lowest and highest value of each column."""
    height, width = image.shape
    for row in range(first, end):
        top = max(row * TILE_PX - 1, 0)
        for x in range(np.uint32(width)):
            across[0, x], across[1, x] = image[top, x], image[top, x]
        for y in range(top + 1, min((row + 1) * TILE_PX + 1, height)):
            for x in range(np.uint32(width)):
                value = image[y, x]
                across[0, x] = value if value < across[0, x] else across[0, x]
                across[1, x] = value if value > across[1, x] else across[1, x]
        for column in range(ranges.shape[1]):
            left = max(column * TILE_PX - 1, 0)
            low, high = across[0, left], across[1, left]
            for x in range(left + 1, min((column + 1) * TILE_PX + 1, width)):
                low, high = min(low, across[0, x]), max(high, across[1, x])
            ranges[row, column, 0], ranges[row, column, 1] = low, high


@inlined
def widened(low: Any, high: Any, ranges: Any, x0: Any, y0: Any, x1: Any, y1: Any) -> Any:
    """Range widened to all values between the places (x0, y0) and (x1, y1) [px]."""
    rows, columns, _ = ranges.shape
    for row in range(max(int(y0) // TILE_PX, 0), min(int(y1) // TILE_PX + 1, rows)):
        for column in range(max(int(x0) // TILE_PX, 0), min(int(x1) // TILE_PX + 1, columns)):
            low, high = min(low, ranges[row, column, 0]), max(high, ranges[row, column, 1])
    return low, high
