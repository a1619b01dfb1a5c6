"""Where each of sixteen pixels near edges of depth comes from, looked for at every sample.

A pixel keeps up a place in both pictures: it goes on as it went last, and is mended by the motion that
the picture knows there. One that leads nowhere is begun anew from the motion at the pixel itself.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic

from carlaloc_env.core.jit import inlined
from carlaloc_env.sensors.event_camera.interpolation import between
from carlaloc_env.sensors.event_camera.simd import (
    FLOATS,
    I32,
    I64,
    Room,
    Wide,
    cells_at,
    data_of,
    neighbours,
    spread,
    within,
)
from carlaloc_env.sensors.event_camera.simd_state import DRIFT, FREE_ROW, LEVELS, U, V
from carlaloc_env.sensors.imaging.motion_warping import MISS_PX, SAME_DEPTH

WAY_ROWS = 13
FIRST_WAY, SECOND_WAY, OVER_WAY = (FREE_ROW + k * WAY_ROWS for k in range(3))
"""First rows of what is known of a place in the first picture, in the second, and in the first one of
what passes in front."""
AT, STEP, LAST_AT, KNOWN, MISS, DEPTH, OWN, WHEN = 0, 2, 4, 6, 7, 8, 9, 12
"""Rows of a way: place (x, y), its last step, place one sample before, whether it was found; by how far
it misses the pixel [px], depth there [m]; motion of the pixel itself (du, dv, ratio);
time since that picture, 0 to 1."""
HELD = FREE_ROW + 3 * WAY_ROWS
SHOWN, WEIGHT = HELD + 1, HELD + 3
"""Rows: the signal without its leak; place in the first picture, and weights of both pictures."""
THROUGH = HELD + 5
"""Row: whether something nearer passes over the pixel."""
ROWS = HELD + 6
"""Rows of all kernels."""
EDGE_RATIO = 1.08
"""Neighbours whose depths differ by more, as a ratio, lie on both sides of an edge; as in `motion_at`."""
CLOSE_PX = 0.25
"""A place that misses its pixel by less is not mended again [px]."""
MENDED = 3
"""Most times that a place is mended at one time."""


@intrinsic
def _fill(typing: Any, row: Any, value: Any, lanes: Any) -> Any:
    """Fill a row with one number."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        room = Room(context, builder, signature.args[2], arguments[2])
        room[arguments[0]] = spread(builder, arguments[1])
        return context.get_dummy_value()

    return types.void(types.int32, types.float32, lanes), generate


@intrinsic
def _go_on(typing: Any, way: Any, anew: Any, lanes: Any) -> Any:
    """Guess the next places of a way: as they went last.

    Args: the way; which places move as their pixels do instead: none (0), those that are lost (1), all (2).
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        room = Room(context, builder, signature.args[2], arguments[2])
        row = _rows_of(builder, arguments[0])
        anew, s, ratio = spread(builder, arguments[1]), room[row(WHEN)], room[row(OWN + 2)]
        tau = s * ratio / ((s * -1.0 + 1.0) + s * ratio)
        lost = (anew > 1.0) | ((anew > 0.0) & (room[row(KNOWN)] <= 0.0))
        for part, pixel in ((0, U), (1, V)):
            at = room[row(AT + part)]
            room[row(LAST_AT + part)] = at
            own = room[pixel] - tau * room[row(OWN + part)]
            room[row(AT + part)] = lost.pick(own, at + room[row(STEP + part)])
        return context.get_dummy_value()

    return types.void(types.int32, types.float32, lanes), generate


@intrinsic
def _mend(typing: Any, field: Any, width: Any, height: Any, way: Any, nearest: Any, lanes: Any) -> Any:
    """Mend the places of a way by the motion there; pixels, as bits, that need it once more.

    Args: the picture's field (H·W·4,) and size, the way, depth beyond which it is not worth another time [m].
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = data_of(context, builder, signature.args[0], arguments[0])
        room = Room(context, builder, signature.args[5], arguments[5])
        width, height = arguments[1:3]
        row = _rows_of(builder, arguments[3])
        s, nearest = room[row(WHEN)], spread(builder, arguments[4])
        x, y = room[row(AT)], room[row(AT + 1)]
        du, dv, ratio, depth = _motion_at(builder, data, width, height, x, y)
        scale = (s * -1.0 + 1.0) + s * ratio
        tau = s * ratio / scale
        u, v = room[U] - tau * du, room[V] - tau * dv
        miss = (u - x).size().most((v - y).size())
        one = ir.Constant(I32, 1)
        right, bottom = (
            spread(builder, builder.sitofp(builder.sub(size, one), ir.FloatType()))
            for size in (width, height)
        )
        inside = (u >= 0.0) & (v >= 0.0) & (u <= right) & (v <= bottom)
        room[row(AT)], room[row(AT + 1)] = u, v
        room[row(MISS)] = inside.pick(miss, 1e3)
        room[row(DEPTH)] = depth * scale
        return (inside & (miss >= CLOSE_PX) & (room[row(KNOWN)] > 0.0) & (depth < nearest)).bits()

    whole = types.int32
    return whole(field, whole, whole, whole, types.float32, lanes), generate


@intrinsic
def _decide(typing: Any, time: Any, lanes: Any) -> Any:
    """Which pictures show what the pixels see; where they show different surfaces, the nearer one."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        room = Room(context, builder, signature.args[1], arguments[1])
        s = spread(builder, arguments[0])
        none, all_of = s * 0.0, s * 0.0 + 1.0
        known = []
        for way in (FIRST_WAY, SECOND_WAY):
            found = room[way + MISS] < float(MISS_PX)
            going = found & (room[way + KNOWN] > 0.0)
            for part in (0, 1):
                step = room[way + AT + part] - room[way + LAST_AT + part]
                room[way + STEP + part] = going.pick(step, none)
            room[way + KNOWN] = found.pick(all_of, none)
            known.append(found)
        a, b = known
        a_depth, b_depth = room[FIRST_WAY + DEPTH], room[SECOND_WAY + DEPTH]
        same = (a_depth - b_depth).size() <= a_depth.least(b_depth) * float(SAME_DEPTH)
        both = a & b & same
        first = a & (~b | (a_depth < b_depth))
        room[WEIGHT] = both.pick(all_of - s, first.pick(all_of, none))
        room[WEIGHT + 1] = both.pick(s, (b & ~first).pick(all_of, none))
        for part in (0, 1):
            room[SHOWN + part] = room[FIRST_WAY + AT + part]
        return context.get_dummy_value()

    return types.void(types.float32, lanes), generate


@intrinsic
def _cover(typing: Any, lanes: Any) -> Any:
    """Show what passes in front where it is nearer than what the pixels would see."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        room = Room(context, builder, signature.args[0], arguments[0])
        first, second = room[WEIGHT], room[WEIGHT + 1]
        none = first * 0.0
        depth = (first > 0.0).pick(
            room[FIRST_WAY + DEPTH], (second > 0.0).pick(room[SECOND_WAY + DEPTH], none + 1e9)
        )
        hidden = room[OVER_WAY + MISS] < float(MISS_PX)
        hidden = hidden & (room[THROUGH] > 0.0) & (room[OVER_WAY + DEPTH] < depth * 0.9)
        room[WEIGHT], room[WEIGHT + 1] = hidden.pick(none + 1.0, first), hidden.pick(none, second)
        for part in (0, 1):
            room[SHOWN + part] = hidden.pick(room[OVER_WAY + AT + part], room[SHOWN + part])
        return context.get_dummy_value()

    return types.void(lanes), generate


@intrinsic
def _see(
    typing: Any, before: Any, after: Any, width: Any, height: Any, time: Any, sample: Any, lanes: Any
) -> Any:
    """Note the signal at the places that were found as that of a sample; held where there is none."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pictures = [data_of(context, builder, signature.args[k], arguments[k]) for k in (0, 1)]
        _, _, width, height, time, sample, _ = arguments
        room = Room(context, builder, signature.args[6], arguments[6])
        places = (room[SHOWN], room[SHOWN + 1]), (room[SECOND_WAY + AT], room[SECOND_WAY + AT + 1])
        none = room[WEIGHT] * 0.0
        level = none
        for part, (picture, (x, y)) in enumerate(zip(pictures, places, strict=True)):
            weight = room[WEIGHT + part]
            seen = weight * between(context, builder, picture, width, height, x, y)
            level = level + (weight > 0.0).pick(seen, none)
        level = (room[WEIGHT] + room[WEIGHT + 1] > 0.0).pick(level, room[HELD])
        room[HELD] = level
        level = level + room[DRIFT] * spread(builder, time)
        room[builder.add(ir.Constant(I32, LEVELS), sample)] = level
        return context.get_dummy_value()

    whole = types.int32
    return types.void(before, after, whole, whole, types.float32, whole, lanes), generate


def _rows_of(builder: Any, way: Any) -> Any:
    """Rows of a way from its first one, i32."""
    return lambda row: builder.add(way, ir.Constant(I32, row))


def _motion_at(
    builder: Any, field: Any, width: Any, height: Any, x: Wide, y: Wide
) -> tuple[Wide, Wide, Wide, Wide]:
    """Motion at places between pixels; across an edge that of the nearest pixel. (du, dv, ratio, depth)."""
    i, j = within(x, width).words(), within(y, height).words()
    a = x - Wide(builder, builder.sitofp(i, FLOATS))
    b = y - Wide(builder, builder.sitofp(j, FLOATS))
    row = spread(builder, width).value
    cells = cells_at(builder, field, builder.add(builder.mul(j, row), i))
    below = builder.shl(builder.sext(width, I64), ir.Constant(I64, 2))
    q00, q01 = neighbours(builder, cells, ir.Constant(I64, 0))
    q10, q11 = neighbours(builder, cells, below)
    low = q00[3].least(q01[3]).least(q10[3].least(q11[3]))
    high = q00[3].most(q01[3]).most(q10[3].most(q11[3]))
    edge, right, down = high > low * EDGE_RATIO, a >= 0.5, b >= 0.5
    found = []
    for v00, v01, v10, v11 in zip(q00, q01, q10, q11, strict=True):
        up, under = v00 + a * (v01 - v00), v10 + a * (v11 - v10)
        nearest = down.pick(right.pick(v11, v10), right.pick(v01, v00))
        found.append(edge.pick(nearest, up + b * (under - up)))
    return found[0], found[1], found[2], found[3]


# Under a type that callers may call as functions.
fill: Any = _fill
go_on: Any = _go_on
mend: Any = _mend
decide: Any = _decide
cover: Any = _cover
see: Any = _see


@inlined
def search(field: Any, width: Any, height: Any, way: int, lanes: Any) -> None:
    """Look for the places of a way from where they are thought to be, in a field (H·W·4,)."""
    for _ in range(MENDED):
        if mend(field, width, height, np.int32(way), np.float32(1e9), lanes) == 0:
            break
