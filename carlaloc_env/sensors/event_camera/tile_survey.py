"""Motion of the tiles of a picture, and the range of intensities that their pixels can meet on the way.

A tile moves smoothly if the motion of its pixels lies on a plane in both pictures: then it is enough to
search where its four corners lie, at the ends of chunks of samples.
"""

import math
from typing import Any, NamedTuple

import cv2
import numpy as np

from carlaloc_env.core.array_types import F32
from carlaloc_env.core.jit import compiled, inlined
from carlaloc_env.sensors.imaging.motion_field import TILE_PX
from carlaloc_env.sensors.imaging.shutter import BOTH, FIRST, sources

STEPS_MAX = 512
"""Most samples of a pixel between two pictures."""
CHUNK = 16
"""Samples between two places of a smooth tile's corners."""
CHUNKS_MAX = -(-STEPS_MAX // CHUNK)
SMOOTH_PX = np.float32(0.3)
"""Motion in a smooth tile differs by less from what its corners say [px]."""
NEARER = np.float32(0.8)
"""What passes in front of something is nearer by this ratio."""
ONE, ZERO = np.float32(1), np.float32(0)
_FAR = np.float32(1e9)


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


class Pictures(NamedTuple):
    """Log intensity at the beginning and at the end of the span, (H, W), and its ranges in tiles."""

    before: Any
    after: Any
    ranges_before: Any
    ranges_after: Any


class Fields(NamedTuple):
    """The arrays of a `FrameMotion`."""

    forward: Any
    backward: Any
    passing: Any


class Tile(NamedTuple):
    """Pixels that are sampled alike: their first and last row and column."""

    y0: Any
    x0: Any
    y1: Any
    x1: Any


class TileMotion(NamedTuple):
    """Motion of a tile."""

    steps: Any
    """Number of samples of its pixels."""
    smooth: Any
    """Whether it moves smoothly and nothing hides its corners."""
    crossed: Any
    """Whether a surface passes over it that is nearer than its farthest pixel."""


class TileNotes(NamedTuple):
    """Places of a tile and its range of intensities: arrays that are used for one tile after another."""

    corners: Any
    """Places of its corners in both pictures (x, y, x, y) at the ends of chunks [px], shape (n + 1, 4, 4)."""
    seen_in: Any
    """Which pictures show it at the ends of chunks: BOTH or FIRST, shape (n + 1,)."""
    bounds: Any
    """Lowest and highest log intensity that it can meet in each chunk, shape (n, 2)."""


def new_notes() -> TileNotes:
    """Arrays for one tile."""
    return TileNotes(
        corners=np.zeros((CHUNKS_MAX + 1, 4, 4), np.float32),
        seen_in=np.zeros(CHUNKS_MAX + 1, np.int64),
        bounds=np.zeros((CHUNKS_MAX, 2), np.float32),
    )


@compiled
def survey(pictures: Any, fields: Any, tile: Any, step_px: Any, notes: Any) -> Any:
    """Motion of a tile, so many samples that nothing moves by more than `step_px` from one to the next.

    Fills in the notes: corners of smooth tiles, bounds of all.
    """
    over = fields.passing[tile.y0 // TILE_PX, tile.x0 // TILE_PX]
    longest, farthest = _motion_range(fields, tile)
    crossed = is_nearer(over, farthest)
    if crossed:
        longest = max(longest, max(abs(over[0]), abs(over[1])))
    steps = min(max(math.ceil(longest / step_px), 1), STEPS_MAX)
    smooth = _is_plane(fields.forward, tile) and _is_plane(fields.backward, tile)
    smooth = smooth and (steps == 1 or _follow_corners(fields, tile, steps, notes))
    chunks = (steps + CHUNK - 1) // CHUNK
    if smooth and not crossed and steps > 1:
        for k in range(chunks):
            low, high = _range_along(pictures, tile, k, k == chunks - 1, notes)
            notes.bounds[k, 0], notes.bounds[k, 1] = low, high
    else:
        low, high = _range_around(pictures, tile, longest)
        for k in range(chunks):
            notes.bounds[k, 0], notes.bounds[k, 1] = low, high
    return TileMotion(steps, smooth, crossed)


@inlined
def is_nearer(over: Any, depth_m: Any) -> bool:
    """Whether the surface that passes over a tile comes in front of what is at a depth [m]."""
    nearer: bool = over[3] > 0 and over[3] * min(ONE, over[2]) < NEARER * depth_m
    return nearer


@inlined
def depth_of(fields: Any, y: int, x: int) -> Any:
    """Least depth of what a pixel shows in either picture, on its way to the other [m]."""
    ahead, back = fields.forward[y, x], fields.backward[y, x]
    return min(ahead[3] * min(ONE, ahead[2]), back[3] * min(ONE, back[2]))


@inlined
def _motion_range(fields: Any, tile: Any) -> Any:
    """Longest motion of a tile's pixels along one axis [px], and depth of the farthest [m]."""
    longest, farthest = ZERO, ZERO
    for y in range(np.uint32(tile.y0), np.uint32(tile.y1 + 1)):
        for x in range(np.uint32(tile.x0), np.uint32(tile.x1 + 1)):
            farthest = max(farthest, depth_of(fields, y, x))
            for field in (fields.forward, fields.backward):
                longest = max(longest, max(abs(field[y, x, 0]), abs(field[y, x, 1])))
    return longest, farthest


@inlined
def _is_plane(field: Any, tile: Any) -> bool:
    """Whether the motion of all pixels lies on the plane through that of the corners."""
    y0, x0, y1, x1 = tile
    down, along = ONE / np.float32(max(y1 - y0, 1)), ONE / np.float32(max(x1 - x0, 1))
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


@inlined
def _follow_corners(fields: Any, tile: Any, steps: int, notes: Any) -> bool:
    """Note where the corners lie in both pictures at the ends of all chunks; False if one is hidden."""
    for corner in range(4):
        y, x = tile.y1 if corner >= 2 else tile.y0, tile.x1 if corner % 2 else tile.x0
        for k in range((steps + CHUNK - 1) // CHUNK + 1):
            s = np.float32(min(k * CHUNK, steps)) / np.float32(steps)
            ax, ay, bx, by = own_places(fields, y, x, s)
            u, v = np.float32(x), np.float32(y)
            ax, ay, bx, by, seen_in = sources(fields.forward, fields.backward, u, v, s, ax, ay, bx, by)
            # What leaves the second picture, or goes behind something there, is followed in the first.
            if seen_in != BOTH and seen_in != FIRST:
                return False
            if corner == 0 or seen_in == FIRST:
                notes.seen_in[k] = seen_in
            here = notes.corners[k, corner]
            here[0], here[1], here[2], here[3] = ax, ay, bx, by
    return True


@inlined
def own_places(fields: Any, y: int, x: int, s: Any) -> Any:
    """Places in both pictures, if all around moved as the pixel itself does: a guess."""
    ahead, back, rest = fields.forward[y, x], fields.backward[y, x], ONE - s
    u, v = np.float32(x), np.float32(y)
    return u + s * back[0], v + s * back[1], u + rest * ahead[0], v + rest * ahead[1]


@inlined
def _range_along(pictures: Any, tile: Any, k: int, is_last: bool, notes: Any) -> Any:
    """Lowest and highest log intensity between the places of the corners at the ends of chunk k."""
    low, high = _FAR, -_FAR
    if is_last:
        row, column = tile.y0 // TILE_PX, tile.x0 // TILE_PX
        low, high = pictures.ranges_after[row, column, 0], pictures.ranges_after[row, column, 1]
    in_both = notes.seen_in[k] == BOTH and notes.seen_in[k + 1] == BOTH
    for part in range(2 if in_both else 1):
        left, right, top, bottom = _FAR, ZERO, _FAR, ZERO
        for knot in (k, k + 1):
            for corner in range(4):
                x, y = notes.corners[knot, corner, 2 * part], notes.corners[knot, corner, 2 * part + 1]
                left, right = min(left, x), max(right, x)
                top, bottom = min(top, y), max(bottom, y)
        ranges = pictures.ranges_before if part == 0 else pictures.ranges_after
        low, high = widened(low, high, ranges, left, top, right, bottom)
    return low, high


@inlined
def _range_around(pictures: Any, tile: Any, reach_px: Any) -> Any:
    """Lowest and highest log intensity within a reach of the tile."""
    x0, y0 = np.float32(tile.x0) - reach_px, np.float32(tile.y0) - reach_px
    x1, y1 = np.float32(tile.x1) + reach_px, np.float32(tile.y1) + reach_px
    low, high = widened(_FAR, -_FAR, pictures.ranges_before, x0, y0, x1, y1)
    return widened(low, high, pictures.ranges_after, x0, y0, x1, y1)
