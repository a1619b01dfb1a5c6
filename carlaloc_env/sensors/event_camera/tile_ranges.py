"""The lowest and highest value of a picture in each of its tiles: limits of what a pixel can meet there."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from carlaloc_env.core.array_types import F32
from carlaloc_env.core.jit import inlined
from carlaloc_env.sensors.imaging.motion_field import TILE_PX


def tile_ranges(image: F32) -> F32:
    """Lowest and highest value in each tile and one pixel around it, shape (h, w, 2)."""
    box = np.ones((TILE_PX + 2, TILE_PX + 2), np.uint8)
    ends = (change(image, box, anchor=(1, 1))[::TILE_PX, ::TILE_PX] for change in (cv2.erode, cv2.dilate))
    return np.stack(list(ends), axis=-1)


@inlined
def widened(low: Any, high: Any, ranges: Any, x0: Any, y0: Any, x1: Any, y1: Any) -> Any:
    """Range widened to all values between the places (x0, y0) and (x1, y1) [px]."""
    rows, columns, _ = ranges.shape
    for row in range(max(int(y0) // TILE_PX, 0), min(int(y1) // TILE_PX + 1, rows)):
        for column in range(max(int(x0) // TILE_PX, 0), min(int(x1) // TILE_PX + 1, columns)):
            low, high = min(low, ranges[row, column, 0]), max(high, ranges[row, column, 1])
    return low, high
