"""Kernels: where a pixel comes from between two pictures, and what it can meet on the way."""

from __future__ import annotations

from typing import Any

import numpy as np

from carlaloc_env.core.array_types import F32
from carlaloc_env.core.jit import compiled, over_bands
from carlaloc_env.sensors.imaging.motion_field import TILE_PX, bilinear, motion_at, source_of

SAME_DEPTH = np.float32(0.10)
"""Depths that differ by less, as a ratio, are of the same surface."""
MISS_PX = np.float32(0.75)
"""A place that misses its pixel by more shows something else [px]."""
BOTH, FIRST, SECOND, NOWHERE = 0, 1, 2, 3
"""Which of two pictures show what a pixel sees in between."""
_ONE = np.float32(1)


@compiled
def sources(forward: Any, backward: Any, u: Any, v: Any, s: Any, ax: Any, ay: Any, bx: Any, by: Any) -> Any:
    """Where a pixel at time s came from in both pictures, from guesses, and which of them shows it.

    Where they show different surfaces the nearer one hides the other. A guess that leads nowhere is
    followed by that of a surface which moves all over as it does at the pixel itself.
    """
    rest = _ONE - s
    ax, ay, a_depth, a_miss = source_of(forward, u, v, s, ax, ay)
    if a_miss >= MISS_PX:
        ax, ay, a_depth, a_miss = source_of(forward, u, v, s, u, v)
    bx, by, b_depth, b_miss = source_of(backward, u, v, rest, bx, by)
    if b_miss >= MISS_PX:
        bx, by, b_depth, b_miss = source_of(backward, u, v, rest, u, v)
    kind = BOTH
    if a_miss >= MISS_PX or b_miss >= MISS_PX:
        kind = FIRST if a_miss < MISS_PX else SECOND if b_miss < MISS_PX else NOWHERE
        if a_miss >= MISS_PX and is_within(forward, ax, ay):
            ax, ay = u, v
        if b_miss >= MISS_PX and is_within(backward, bx, by):
            bx, by = u, v
    elif abs(a_depth - b_depth) > SAME_DEPTH * min(a_depth, b_depth):
        kind = FIRST if a_depth < b_depth else SECOND
    return ax, ay, bx, by, kind


@compiled
def is_within(field: Any, x: Any, y: Any) -> bool:
    """Whether a place lies in the picture."""
    inside: bool = x >= 0 and y >= 0 and x <= field.shape[1] - 1 and y <= field.shape[0] - 1
    return inside


@compiled
def mixed(before: Any, after: Any, kind: Any, s: Any, ax: Any, ay: Any, bx: Any, by: Any, held: Any) -> Any:
    """Log intensity at time s from places in both pictures; `held` where neither shows it."""
    if kind == BOTH:
        return (_ONE - s) * bilinear(before, ax, ay) + s * bilinear(after, bx, by)
    if kind == FIRST:
        return bilinear(before, ax, ay)
    if kind == SECOND:
        return bilinear(after, bx, by)
    return held


@compiled
def comes_over(field: Any, over: Any, u: Any, v: Any, s: Any) -> bool:
    """Whether the first picture shows something as near as `over` where that must have come from."""
    tau = s * over[2] / ((_ONE - s) + s * over[2])
    i, j = int(u - tau * over[0]), int(v - tau * over[1])
    if i < 0 or j < 0 or i > field.shape[1] - 2 or j > field.shape[0] - 2:
        return False
    nearest = min(min(field[j, i, 3], field[j, i + 1, 3]), min(field[j + 1, i, 3], field[j + 1, i + 1, 3]))
    found: bool = nearest < np.float32(1.25) * over[3]
    return found


@compiled
def over_place(
    forward: Any,
    backward: Any,
    over: Any,
    u: Any,
    v: Any,
    s: Any,
    ax: Any,
    ay: Any,
    bx: Any,
    by: Any,
    kind: Any,
) -> Any:
    """Whether surface `over` passes in front at time s, and where it was in the first picture."""
    if not comes_over(forward, over, u, v, s):
        return False, u, v
    tau = s * over[2] / ((_ONE - s) + s * over[2])
    x, y, near, miss = source_of(forward, u, v, s, u - tau * over[0], v - tau * over[1])
    if miss >= MISS_PX:
        return False, u, v
    depth = np.float32(1e9)
    if kind in (BOTH, FIRST):
        depth = motion_at(forward, ax, ay)[3]
    elif kind == SECOND:
        depth = motion_at(backward, bx, by)[3]
    if near >= np.float32(0.9) * depth:
        return False, u, v
    return True, x, y


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


@compiled
def range_along(ranges: Any, x0: Any, y0: Any, x1: Any, y1: Any, low: Any, high: Any) -> Any:
    """Range widened to all values that a straight way between two places can meet."""
    left, right = int(min(x0, x1)) // TILE_PX, int(max(x0, x1)) // TILE_PX
    top, bottom = int(min(y0, y1)) // TILE_PX, int(max(y0, y1)) // TILE_PX
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            low = min(low, ranges[row, column, 0])
            high = max(high, ranges[row, column, 1])
    return low, high
