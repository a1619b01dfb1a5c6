"""Kernels of the event camera: where the pixels of a smooth tile come from, and what they can meet.

What moves smoothly is looked for at the four corners of a tile only, at the ends of chunks of
samples; in between it moves straight on.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.compiled import compiled
from carlaloc_env.sensors.event_sampling import LANES
from carlaloc_env.sensors.pixel_ways import BOTH, FIRST, range_along, sources

F32 = NDArray[np.float32]

STEPS_MAX = 512
"""Most samples of a pixel between two pictures."""
CHUNK = LANES
"""Samples between two places that are looked for in both pictures."""
SMOOTH_PX = np.float32(0.3)
"""Motion in a smooth tile differs by less from what its corners say [px]."""
_ONE, _ZERO = np.float32(1), np.float32(0)


def new_scratch() -> tuple[F32, F32, F32]:
    """Room for the notes that `fire_rows` takes of one tile.

    Where its corners come from at the ends of all chunks, x and y in both pictures; and for each
    chunk the lowest and highest intensity, and the kind at its beginning. And the levels of one chunk.
    """
    chunks = STEPS_MAX // CHUNK + 2
    return (
        np.empty((chunks, 4, 4), np.float32),
        np.empty((chunks, 3), np.float32),
        np.empty(CHUNK, np.float32),
    )


@compiled
def tile_steps(fields: Any, row: int, column: int, y0: int, x0: int, y1: int, x1: int, step_px: Any) -> int:
    """Samples of all pixels of a tile that moves smoothly; 0 where they must be looked at one by one."""
    forward, backward, passing = fields
    longest, nearest = _ZERO, np.float32(1e9)
    if not (_is_smooth(forward, y0, x0, y1, x1) and _is_smooth(backward, y0, x0, y1, x1)):
        return 0
    for field in (forward, backward):
        for y in (y0, y1):
            for x in (x0, x1):
                longest = max(longest, max(abs(field[y, x, 0]), abs(field[y, x, 1])))
                nearest = min(nearest, field[y, x, 3] * min(_ONE, field[y, x, 2]))
    over = passing[row, column]
    if over[3] > 0 and over[3] * min(_ONE, over[2]) < np.float32(0.8) * nearest:
        return 0
    steps: int = min(max(math.ceil(longest / step_px), 1), STEPS_MAX)
    return steps


@compiled
def _is_smooth(field: Any, y0: int, x0: int, y1: int, x1: int) -> bool:
    """Whether the motion of all pixels of a tile lies on the plane through those of its corners."""
    down, along = _ONE / np.float32(max(y1 - y0, 1)), _ONE / np.float32(max(x1 - x0, 1))
    for y in range(np.uint32(y0), np.uint32(y1 + 1)):
        g = down * (np.float32(y) - np.float32(y0))
        for part in (np.uint32(0), np.uint32(1)):
            left = field[y0, x0, part] + g * (field[y1, x0, part] - field[y0, x0, part])
            right = field[y0, x1, part] + g * (field[y1, x1, part] - field[y0, x1, part])
            rise = along * (right - left)
            for x in range(np.uint32(x0), np.uint32(x1 + 1)):
                if abs(left + (np.float32(x) - np.float32(x0)) * rise - field[y, x, part]) > SMOOTH_PX:
                    return False
    return True


@compiled
def tile_knots(fields: Any, y0: int, x0: int, y1: int, x1: int, steps: int, knots: Any, bounds: Any) -> bool:
    """Fill in where the corners of a tile come from at the ends of all chunks; False if one is hidden."""
    forward, backward, _ = fields
    chunks = (steps + CHUNK - 1) // CHUNK
    for corner in range(4):
        y, x = y1 if corner >= 2 else y0, x1 if corner % 2 else x0
        u, v = np.float32(x), np.float32(y)
        ax, ay, bx, by = u, v, u + forward[y, x, 0], v + forward[y, x, 1]
        dax, day = backward[y, x, 0], backward[y, x, 1]
        dbx, dby = -forward[y, x, 0], -forward[y, x, 1]
        s0 = _ZERO
        for k in range(chunks + 1):
            s = np.float32(min(k * CHUNK, steps)) / np.float32(steps)
            f = s - s0
            px, py, qx, qy = ax, ay, bx, by
            ax, ay, bx, by, kind = sources(
                forward, backward, u, v, s, ax + f * dax, ay + f * day, bx + f * dbx, by + f * dby
            )
            # What leaves the second picture, or goes behind something there, is followed in the first.
            if kind != BOTH and kind != FIRST:
                return False
            if corner == 0 or kind == FIRST:
                bounds[k, 2] = kind
            if k > 0:
                dax, day, dbx, dby = (ax - px) / f, (ay - py) / f, (bx - qx) / f, (by - qy) / f
            s0 = s
            knots[k, corner, 0], knots[k, corner, 1] = ax, ay
            knots[k, corner, 2], knots[k, corner, 3] = bx, by
    return True


@compiled
def tile_bounds(
    ranges_before: Any, ranges_after: Any, row: int, column: int, knots: Any, steps: int, bounds: Any
) -> Any:
    """Fill in the lowest and highest intensity that a tile meets in each chunk; those of all of them."""
    if steps == 1:
        low = min(ranges_before[row, column, 0], ranges_after[row, column, 0])
        high = max(ranges_before[row, column, 1], ranges_after[row, column, 1])
        bounds[0, 0], bounds[0, 1] = low, high
        return low, high
    lowest, highest = np.float32(1e9), np.float32(-1e9)
    chunks = (steps + CHUNK - 1) // CHUNK
    for k in range(chunks):
        low, high = np.float32(1e9), np.float32(-1e9)
        if k == chunks - 1:
            low, high = ranges_after[row, column, 0], ranges_after[row, column, 1]
        for part in range(2 if bounds[k, 2] == BOTH and bounds[k + 1, 2] == BOTH else 1):
            left, right = np.float32(1e9), _ZERO
            top, bottom = np.float32(1e9), _ZERO
            for knot in (k, k + 1):
                for corner in range(4):
                    x, y = knots[knot, corner, 2 * part], knots[knot, corner, 2 * part + 1]
                    left, right = min(left, x), max(right, x)
                    top, bottom = min(top, y), max(bottom, y)
            ranges = ranges_before if part == 0 else ranges_after
            low, high = range_along(ranges, left, top, right, bottom, low, high)
        bounds[k, 0], bounds[k, 1] = low, high
        lowest, highest = min(lowest, low), max(highest, high)
    return lowest, highest
