"""Kernels of the event camera: where the pixels of a smooth tile come from, and what they can meet.

What moves smoothly is looked for at the four corners of a tile only, at the ends of chunks of
samples; in between it moves straight on.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32
from carlaloc_env.core.jit import inlined
from carlaloc_env.sensors.event_camera.crossing_queue import MARK_ROWS
from carlaloc_env.sensors.event_camera.edge_search import (
    AT,
    DEPTH,
    FIRST_WAY,
    KNOWN,
    MISS,
    OWN,
    ROWS,
    SECOND_WAY,
    WHEN,
    go_on,
    search,
)
from carlaloc_env.sensors.event_camera.simd import FLOATS, I32, I64, LANES, WORDS, Wide, data_of, spread
from carlaloc_env.sensors.event_camera.simd_state import CHUNK, U, V
from carlaloc_env.sensors.imaging.motion_field import TILE_PX
from carlaloc_env.sensors.imaging.motion_warping import (
    BOTH,
    FIRST,
    MISS_PX,
    NOWHERE,
    SAME_DEPTH,
    SECOND,
    range_along,
)

STEPS_MAX = 512
"""Most samples of a pixel between two pictures."""
SMOOTH_PX = np.float32(0.3)
"""Motion in a smooth tile differs by less from what its corners say [px]."""
_KNOTS = LANES // 4
_LINE_BYTES = 64
_ONE, _ZERO = np.float32(1), np.float32(0)


Scratch = tuple[F32, F32, F32, NDArray[np.int32]]


def new_scratch() -> Scratch:
    """Room for the notes that `fire_rows` takes of one tile.

    Where its corners come from at the ends of all chunks, x and y in both pictures; and for each
    chunk the lowest and highest intensity, and the kind at its beginning. And the numbers of sixteen
    pixels, and their whole numbers.
    """
    chunks = STEPS_MAX // CHUNK + 2
    return (
        np.zeros((chunks, 4, 4), np.float32),
        np.zeros((chunks, 3), np.float32),
        _aligned(ROWS).view(np.float32).reshape(-1),
        _aligned(MARK_ROWS),
    )


def _aligned(rows: int) -> NDArray[np.int32]:
    """Rows of zeros none of which lies in two lines of the processor's cache."""
    room = np.zeros((rows + 1) * LANES, np.int32)
    first = -room.ctypes.data % _LINE_BYTES // room.itemsize
    return room[first : first + rows * LANES].reshape(rows, LANES)


@intrinsic
def _bends(typing: Any, flat: Any, top: Any, bottom: Any, row: Any, part: Any, along: Any, most: Any) -> Any:
    """Whether the motion (du, dv) of eight pixels in a row is off the plane through a tile's corners.

    Args: the field (H·W·4,); where in it the tile's top left pixel, its bottom left one and the row's first
    one are; part of the way from top to bottom; 1 / (pixels in a row − 1); by how much it may be off [px].
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = data_of(context, builder, signature.args[0], arguments[0])
        top, bottom, row = arguments[1:4]
        part, along, most = (spread(builder, a) for a in arguments[4:7])
        four = ir.VectorType(FLOATS.element, 4)

        def loaded(at: Any, pixels: int, kind: Any) -> Any:
            place = builder.gep(data, [builder.add(at, ir.Constant(I64, 4 * pixels))])
            value = builder.load(builder.bitcast(place, kind.as_pointer()))
            value.align = 4
            return value

        def corner(at: Any, pixels: int) -> Wide:
            value, order = loaded(at, pixels, four), ir.Constant(WORDS, [0, 1, 2, 3] * 4)
            return Wide(builder, builder.shuffle_vector(value, value, order))

        left, right = (
            corner(top, side) + part * (corner(bottom, side) - corner(top, side)) for side in (0, 7)
        )
        rise = along * (right - left)
        halves = []
        for first in (0, 4):
            steps = Wide(builder, ir.Constant(FLOATS, [float(first + lane // 4) for lane in range(LANES)]))
            error = left + steps * rise - Wide(builder, loaded(row, first, FLOATS))
            halves.append((error > most) | (error < most * -1.0))
        motion = ir.Constant(I32, sum(1 << lane for lane in range(LANES) if lane % 4 < 2))
        return builder.and_((halves[0] | halves[1]).bits(), motion)

    real, long = types.float32, types.int64
    return types.int32(flat, long, long, long, real, real, real), generate


# Under a type that callers may call as a function.
bends: Any = _bends


@inlined
def tile_steps(fields: Any, row: int, column: int, y0: int, x0: int, y1: int, x1: int, step_px: Any) -> int:
    """Samples of all pixels of a tile that moves smoothly; 0 where they must be looked at one by one."""
    forward, backward, passing, flat_forward, flat_backward = fields
    longest, nearest = _ZERO, np.float32(1e9)
    for field, flat in ((forward, flat_forward), (backward, flat_backward)):
        if not _is_smooth(field, flat, y0, x0, y1, x1):
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


@inlined
def _is_smooth(field: Any, flat: Any, y0: int, x0: int, y1: int, x1: int) -> bool:
    """Whether the motion of all pixels of a tile lies on the plane through those of its corners."""
    down, along = _ONE / np.float32(max(y1 - y0, 1)), _ONE / np.float32(max(x1 - x0, 1))
    if x1 - x0 == TILE_PX - 1:
        return _is_smooth_row_by_row(field, flat, y0, x0, y1, down, along)
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
def _is_smooth_row_by_row(field: Any, flat: Any, y0: int, x0: int, y1: int, down: Any, along: Any) -> bool:
    """The same for tiles that are not cut off at the right."""
    width = field.shape[1]
    top, bottom = 4 * (y0 * width + x0), 4 * (y1 * width + x0)
    for y in range(y0, y1 + 1):
        g = down * (np.float32(y) - np.float32(y0))
        if bends(flat, top, bottom, 4 * (y * width + x0), g, along, SMOOTH_PX) != 0:
            return False
    return True


@inlined
def tile_knots(fields: Any, corners: Any, steps: int, knots: Any, bounds: Any, lanes: Any) -> bool:
    """Fill in where the corners of a tile come from at the ends of all chunks; False if one is hidden."""
    forward, backward, _, flat_forward, flat_backward = fields
    height, width = np.int32(forward.shape[0]), np.int32(forward.shape[1])
    count = (steps + CHUNK - 1) // CHUNK + 1
    _take_corners(forward, backward, corners, lanes)
    for first in range(0, count, _KNOTS):
        for lane in range(LANES):
            s = np.float32(min((first + lane // 4) * CHUNK, steps)) / np.float32(steps)
            lanes[(FIRST_WAY + WHEN) * LANES + lane] = s
            lanes[(SECOND_WAY + WHEN) * LANES + lane] = _ONE - s
        for way in (FIRST_WAY, SECOND_WAY):
            go_on(np.int32(way), np.float32(2), lanes)
        search(flat_forward, width, height, FIRST_WAY, lanes)
        search(flat_backward, width, height, SECOND_WAY, lanes)
        for lane in range(4 * min(_KNOTS, count - first)):
            k, corner = first + lane // 4, lane % 4
            kind = _kind_of(lane, lanes)
            # What leaves the second picture, or goes behind something there, is followed in the first.
            if kind != BOTH and kind != FIRST:
                return False
            if corner == 0 or kind == FIRST:
                bounds[k, 2] = kind
            for part in range(2):
                knots[k, corner, part] = lanes[(FIRST_WAY + AT + part) * LANES + lane]
                knots[k, corner, 2 + part] = lanes[(SECOND_WAY + AT + part) * LANES + lane]
    return True


@inlined
def _take_corners(forward: Any, backward: Any, corners: Any, lanes: Any) -> None:
    """Take the corners of a tile as pixels, as often as there is room.

    Where they come from in one picture is what the other one knows to move there, just so at its own time.
    """
    y0, x0, y1, x1 = corners
    for lane in range(LANES):
        y, x = y1 if lane & 2 else y0, x1 if lane & 1 else x0
        lanes[U * LANES + lane], lanes[V * LANES + lane] = np.float32(x), np.float32(y)
        for part in range(2):
            lanes[(FIRST_WAY + OWN + part) * LANES + lane] = -backward[y, x, part]
            lanes[(SECOND_WAY + OWN + part) * LANES + lane] = -forward[y, x, part]
        lanes[(FIRST_WAY + OWN + 2) * LANES + lane] = backward[y, x, 2]
        lanes[(SECOND_WAY + OWN + 2) * LANES + lane] = forward[y, x, 2]
        lanes[(FIRST_WAY + KNOWN) * LANES + lane] = _ONE
        lanes[(SECOND_WAY + KNOWN) * LANES + lane] = _ONE


@inlined
def _kind_of(lane: int, lanes: Any) -> int:
    """Which of two pictures show what a pixel sees; where they show different surfaces, the nearer one."""
    a = lanes[(FIRST_WAY + MISS) * LANES + lane] < MISS_PX
    b = lanes[(SECOND_WAY + MISS) * LANES + lane] < MISS_PX
    if not a or not b:
        return FIRST if a else SECOND if b else NOWHERE
    a_depth = lanes[(FIRST_WAY + DEPTH) * LANES + lane]
    b_depth = lanes[(SECOND_WAY + DEPTH) * LANES + lane]
    if abs(a_depth - b_depth) <= SAME_DEPTH * min(a_depth, b_depth):
        return BOTH
    return FIRST if a_depth < b_depth else SECOND


@inlined
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
