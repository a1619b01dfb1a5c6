"""Values of a picture between its pixels, sixteen places at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils

from carlaloc_env.sensors.event_camera.simd import (
    FLOATS,
    I32,
    I64,
    LANES,
    WORDS,
    Wide,
    all_of,
    spread,
    within,
)

_WINDOW_ROWS = 4


def between(context: Any, builder: Any, picture: Any, width: Any, height: Any, x: Wide, y: Wide) -> Wide:
    """Bilinear values of a picture at places; of those outside, numbers without meaning.

    Args:
        context: Of the target.
        builder: Of the code around.
        picture: Pointer to the picture's pixels, row by row.
        width: Its pixels in a row, i32.
        height: Its rows, i32.
        x: Places along a row [px].
        y: Places across the rows [px].
    """
    i, j = within(x, width).words(), within(y, height).words()
    return mixed(builder, _corners(context, builder, picture, (width, height), i, j), x, y, i, j)


def mixed(builder: Any, values: Sequence[Wide], x: Wide, y: Wide, i: Any, j: Any) -> Wide:
    """Bilinear values at places from those of the pixels around them, of which `i` and `j` are the first."""
    a = x - Wide(builder, builder.sitofp(i, FLOATS))
    b = y - Wide(builder, builder.sitofp(j, FLOATS))
    v00, v01, v10, v11 = values
    up = v00 + a * (v01 - v00)
    low = v10 + a * (v11 - v10)
    return up + b * (low - up)


def can_pick(context: Any) -> bool:
    """Whether the processor has an instruction for `pick`."""
    return "+avx512f" in context.codegen().magic_tuple()[2]


def _corners(
    context: Any, builder: Any, picture: Any, size: tuple[Any, Any], i: Any, j: Any
) -> tuple[Wide, Wide, Wide, Wide]:
    """Values of a picture of some size (width, height) at columns and rows, right of them, and below both.

    Pixels of a tile mostly come from near each other. Those from within four rows of sixteen columns are
    picked from these, where the processor can, instead of being fetched one by one.
    """
    rows = spread(builder, size[0]).value

    def fetched() -> list[Any]:
        at = builder.add(builder.mul(j, rows), i)
        pairs = (*_pairs(builder, picture, at), *_pairs(builder, picture, builder.add(at, rows)))
        return [one.value for one in pairs]

    if not can_pick(context):
        values = fetched()
    else:
        near, start, at = _window(builder, picture, size, i, j)
        with builder.if_else(near) as (yes, no):
            with yes:
                along = builder.sext(size[0], I64)
                picked = [one.value for one in pick(builder, start, along, _WINDOW_ROWS, at)]
                picked_in = builder.block
            with no:
                found = fetched()
                found_in = builder.block
        values = []
        for one, other in zip(picked, found, strict=True):
            value = builder.phi(FLOATS)
            value.add_incoming(one, picked_in)
            value.add_incoming(other, found_in)
            values.append(value)
    v00, v01, v10, v11 = (Wide(builder, value) for value in values)
    return v00, v01, v10, v11


def _window(builder: Any, picture: Any, size: tuple[Any, Any], i: Any, j: Any) -> tuple[Any, Any, Any]:
    """Four rows of sixteen pixels that may hold all of some columns and rows and what is next to them.

    Returns:
        Whether they do; their first pixel; the pixels' places in them, as in `pick`.
    """

    def lane(words: Any, number: int) -> Any:
        return builder.extract_element(words, ir.Constant(I32, number))

    def first(one: Any, other: Any, room: Any, need: int) -> Any:
        least = builder.select(builder.icmp_signed("<", one, other), one, other)
        last = builder.sub(room, ir.Constant(I32, need))
        return builder.select(builder.icmp_signed("<", least, last), least, last)

    width, height = size
    # A tile's pixels come in two rows of eight.
    left = first(lane(i, 0), lane(i, 8), width, LANES)
    top = first(lane(j, 0), lane(j, 7), height, _WINDOW_ROWS)
    right = builder.sub(i, spread(builder, left).value)
    down = builder.sub(j, spread(builder, top).value)
    within_columns = builder.icmp_unsigned("<", right, ir.Constant(WORDS, [LANES - 1] * LANES))
    within_rows = builder.icmp_unsigned("<", down, ir.Constant(WORDS, [_WINDOW_ROWS - 1] * LANES))
    bits = builder.bitcast(builder.and_(within_columns, within_rows), ir.IntType(LANES))
    near = builder.icmp_unsigned("==", bits, ir.Constant(ir.IntType(LANES), (1 << LANES) - 1))
    for place in (left, top):
        near = builder.and_(near, builder.icmp_signed(">=", place, ir.Constant(I32, 0)))
    at = builder.add(builder.mul(top, width), left)
    start = builder.gep(picture, [builder.sext(at, I64)])
    four = ir.Constant(WORDS, [4] * LANES)
    return near, start, builder.add(builder.shl(down, four), right)


def pick(builder: Any, start: Any, along: Any, count: int, at: Any) -> list[Wide]:
    """The same as `_pairs` twice, from three or four rows of sixteen pixels.

    Args:
        builder: Of the code around.
        start: Pointer to the first row's first pixel.
        along: Pixels from there to the next row's, i64.
        count: Number of rows.
        at: Places of the pixels: the row in the bits above the lowest four, the column in these.
    """
    rows = []
    for number in range(count):
        place = builder.gep(start, [builder.mul(along, ir.Constant(I64, number))])
        row = builder.load(builder.bitcast(place, FLOATS.as_pointer()))
        row.align = 4
        rows.append(row)
    kind = ir.FunctionType(FLOATS, [FLOATS, WORDS, FLOATS])
    declared: Any = cgutils.get_or_insert_function
    permute = declared(builder.module, kind, "llvm.x86.avx512.vpermi2var.ps.512")
    beside = builder.add(at, ir.Constant(WORDS, [1] * LANES))
    upper = builder.icmp_unsigned("<", at, ir.Constant(WORDS, [2 * LANES] * LANES))
    values = []
    for first, last in ((0, 2), (1, 3)):
        for index in (at, beside):
            # The lowest five bits choose from two rows.
            found = builder.call(permute, [rows[first], index, rows[first + 1]])
            if count > 3:
                other = builder.call(permute, [rows[last], index, rows[3]])
                found = builder.select(upper, found, other)
            values.append(Wide(builder, found))
    return values


def _pairs(builder: Any, picture: Any, at: Any) -> tuple[Wide, Wide]:
    """Values at places and to the right of them: one load of 64 bits each, the left one low."""
    long, truths = ir.VectorType(I64, LANES), ir.VectorType(ir.IntType(1), LANES)
    start = all_of(builder, builder.ptrtoint(picture, I64), long)
    bytes_on = builder.shl(builder.sext(at, long), ir.Constant(long, [2] * LANES))
    places = builder.add(start, bytes_on)
    pointers = ir.VectorType(I64.as_pointer(), LANES)
    kind = ir.FunctionType(long, [pointers, I32, truths, long])
    declared: Any = cgutils.get_or_insert_function
    load = declared(builder.module, kind, f"llvm.masked.gather.v{LANES}i64.v{LANES}p0")
    alignment, every = ir.Constant(I32, 4), ir.Constant(truths, [1] * LANES)
    places = builder.inttoptr(places, pointers)
    found = builder.call(load, [places, alignment, every, ir.Constant(long, ir.Undefined)])
    left = builder.bitcast(builder.trunc(found, WORDS), FLOATS)
    shift = ir.Constant(long, [32] * LANES)
    right = builder.bitcast(builder.trunc(builder.lshr(found, shift), WORDS), FLOATS)
    return Wide(builder, left), Wide(builder, right)
