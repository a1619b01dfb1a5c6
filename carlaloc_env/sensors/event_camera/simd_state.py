"""The signal of sixteen pixels along straight ways that their tile's corners know.

Kernels share one array of numbers, `LANES` in a row: where the pixels come from at both ends of a
chunk of samples, what both pictures say there, thresholds, and the signal itself.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic

from carlaloc_env.sensors.event_camera.interpolation import between
from carlaloc_env.sensors.event_camera.simd import (
    F32,
    FLOATS,
    I32,
    I64,
    LANES,
    WORDS,
    Room,
    Wide,
    data_of,
    spread,
)

CHUNK = 16
"""Samples that go together; those of a smooth tile's chunk lie on a straight way."""
U, V, ALONG, DOWN = 0, 1, 2, 3
"""Rows: the pixels [px], and their share of the way across their tile."""
ON, OFF, REFERENCE, UPPER, LOWER, DRIFT = 4, 5, 6, 7, 8, 9
"""Rows: thresholds, level of the last event, levels that make the next, what leaks until the end."""
FINAL = 10
"""Row: the signal at the end, without what leaks."""
BEGIN, END = 11, 18
"""First of seven rows for the ends of a chunk: places in the first picture (x, y) and in the second,
what both say there, and the signal."""
X, Y, DX, DY, MORE, GROWS = 25, 26, 27, 28, 29, 30
"""Rows: the way of a chunk in one picture, and what the signal is above that picture."""
WINDOW = 31
"""Two rows: where the columns (lane 0) and rows (lane 8) begin that a chunk is in, and how they go along."""
LEVELS = 33
"""First of `CHUNK` + 1 rows: the signal before a chunk's samples, and at each of them."""
QUEUE_ROWS = 16
"""Rows of the queue of crossings."""
RISEN, ROSE = LEVELS + CHUNK + 1, LEVELS + CHUNK + 1 + QUEUE_ROWS
"""First rows of the queue: how far the signal had to rise from the sample before, and how far it rose."""
FREE_ROW = ROSE + QUEUE_ROWS
"""First row of other kernels."""
FIRST_SAYS, SECOND_SAYS, SIGNAL = 4, 5, 6
"""Rows of a chunk's end: what both pictures say, and the signal."""
HALF = ir.VectorType(F32, LANES // 2)


@intrinsic
def _gather(typing: Any, flat: Any, first: Any, second: Any, row: Any, lanes: Any) -> Any:
    """Fill a row with eight numbers of an array (N,) from `first` on and eight from `second` on."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = data_of(context, builder, signature.args[0], arguments[0])
        room = Room(context, builder, signature.args[4], arguments[4])
        halves = []
        for at in arguments[1:3]:
            value = builder.load(builder.bitcast(builder.gep(data, [at]), HALF.as_pointer()))
            value.align = 4
            halves.append(value)
        order = ir.Constant(WORDS, list(range(LANES)))
        room[arguments[3]] = Wide(builder, builder.shuffle_vector(*halves, order))
        return context.get_dummy_value()

    return types.void(flat, types.int64, types.int64, types.int32, lanes), generate


@intrinsic
def _scatter(typing: Any, lanes: Any, flat: Any, first: Any, second: Any) -> Any:
    """Put down what the pixels remember: the level of the last event, less what has leaked."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        room = Room(context, builder, signature.args[0], arguments[0])
        data = data_of(context, builder, signature.args[1], arguments[1])
        kept = (room[REFERENCE] - room[DRIFT]).value
        for part, at in enumerate(arguments[2:4]):
            order = ir.Constant(ir.VectorType(I32, 8), list(range(8 * part, 8 * part + 8)))
            half = builder.shuffle_vector(kept, kept, order)
            place = builder.bitcast(builder.gep(data, [at]), HALF.as_pointer())
            builder.store(half, place).align = 4
        return context.get_dummy_value()

    return types.void(lanes, flat, types.int64, types.int64), generate


@intrinsic
def _ready(typing: Any, x: Any, y: Any, along: Any, down: Any, top: Any, leaks: Any, lanes: Any) -> Any:
    """Begin with pixels whose thresholds, reference and pictures are in their rows.

    Args: the first pixel [px], the share of a tile from one to the next along and down, the share of the
    first row, what leaks of a threshold.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        room = Room(context, builder, signature.args[6], arguments[6])
        x, y, along, down, top, leaks = (spread(builder, a) for a in arguments[:6])
        right = Wide(builder, ir.Constant(FLOATS, [float(lane % 8) for lane in range(LANES)]))
        below = Wide(builder, ir.Constant(FLOATS, [float(lane // 8) for lane in range(LANES)]))
        room[U], room[V] = x + right, y + below
        room[ALONG], room[DOWN] = right * along, top + below * down
        room[UPPER], room[LOWER] = room[REFERENCE] + room[ON], room[REFERENCE] - room[OFF]
        room[DRIFT] = leaks * room[ON]
        return context.get_dummy_value()

    real = types.float32
    return types.void(real, real, real, real, real, real, lanes), generate


@intrinsic
def _place(typing: Any, knots: Any, k: Any, lanes: Any) -> Any:
    """Begin a chunk at the end of the last one; places at its end, between those of the tile's corners."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = data_of(context, builder, signature.args[0], arguments[0])
        room = Room(context, builder, signature.args[2], arguments[2])
        for row in range(7):
            room[BEGIN + row] = room[END + row]
        along, down = room[ALONG], room[DOWN]
        first = builder.mul(arguments[1], ir.Constant(I64, 16))
        for part in range(4):
            corner = [
                spread(
                    builder,
                    builder.load(builder.gep(data, [builder.add(first, ir.Constant(I64, 4 * c + part))])),
                )
                for c in range(4)
            ]
            up = corner[0] + along * (corner[1] - corner[0])
            low = corner[2] + along * (corner[3] - corner[2])
            room[END + part] = up + down * (low - up)
        return context.get_dummy_value()

    return types.void(knots, types.int64, lanes), generate


@intrinsic
def _look(typing: Any, flat: Any, width: Any, height: Any, second: Any, lanes: Any) -> Any:
    """What a picture (H·W,) says at the end of a chunk; `second`: 0 or 1, which of both it is."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        picture = data_of(context, builder, signature.args[0], arguments[0])
        room = Room(context, builder, signature.args[4], arguments[4])
        _, width, height, second, _ = arguments
        x = builder.add(ir.Constant(I32, END), builder.add(second, second))
        places = room[x], room[builder.add(x, ir.Constant(I32, 1))]
        seen = between(context, builder, picture, width, height, *places)
        room[builder.add(ir.Constant(I32, END + FIRST_SAYS), second)] = seen
        return context.get_dummy_value()

    return types.void(flat, types.int32, types.int32, types.int32, lanes), generate


@intrinsic
def _mix(typing: Any, weight: Any, lanes: Any) -> Any:
    """Signal at the end of a chunk: `weight` of the second picture."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        room = Room(context, builder, signature.args[1], arguments[1])
        first, second = room[END + FIRST_SAYS], room[END + SECOND_SAYS]
        weight = spread(builder, arguments[0])
        # Without weight the second picture may not have been looked at.
        room[END + SIGNAL] = (weight > 0.0).pick(first + weight * (second - first), first)
        return context.get_dummy_value()

    return types.void(types.float32, lanes), generate


@intrinsic
def _arrive(typing: Any, sample: Any, lanes: Any) -> Any:
    """Note the signal at the end of the span as that of a sample of a chunk."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        room = Room(context, builder, signature.args[1], arguments[1])
        room[builder.add(ir.Constant(I32, LEVELS), arguments[0])] = room[FINAL] + room[DRIFT]
        return context.get_dummy_value()

    return types.void(types.int32, lanes), generate


@intrinsic
def _repeat(typing: Any, sample: Any, lanes: Any) -> Any:
    """Begin a chunk with the signal of a sample of the last one."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        room = Room(context, builder, signature.args[1], arguments[1])
        room[LEVELS] = room[builder.add(ir.Constant(I32, LEVELS), arguments[0])]
        return context.get_dummy_value()

    return types.void(types.int32, lanes), generate


@intrinsic
def _reaches(typing: Any, low: Any, high: Any, lanes: Any) -> Any:
    """Pixels, as bits, that a signal between two levels could make fire."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        room = Room(context, builder, signature.args[2], arguments[2])
        low, high = (spread(builder, a) for a in arguments[:2])
        return ((high + room[DRIFT] >= room[UPPER]) | (low <= room[LOWER])).bits()

    return types.int32(types.float32, types.float32, lanes), generate


@intrinsic
def _lowest(typing: Any, bits: Any) -> Any:
    """Place of the lowest bit that is set."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        found = builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 1))
        return builder.zext(found, I64)

    return types.int64(types.int32), generate


# Under a type that callers may call as functions.
gather: Any = _gather
scatter: Any = _scatter
ready: Any = _ready
place: Any = _place
look: Any = _look
mix: Any = _mix
arrive: Any = _arrive
repeat: Any = _repeat
reaches: Any = _reaches
lowest: Any = _lowest
