"""Values of a picture along a straight way, sixteen at once.

Written in the compiler's own vector operations: + − × and conversions alone, none contracted, so the
bits are those of the same sums one by one.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

LANES = 16
"""Samples taken at once."""


@intrinsic
def _sample(
    typing: Any,
    flat: Any,
    width: Any,
    height: Any,
    x: Any,
    y: Any,
    dx: Any,
    dy: Any,
    more: Any,
    grows: Any,
    levels: Any,
) -> Any:
    """Fill `levels` (16,) with values of a picture (H·W,) between pixels, plus what grows at each step.

    Sample f of 0 to 15 is taken at (x, y) + (f + 1)·(dx, dy) and gets `more` + (f + 1)·`grows` added.
    Places outside the picture, as those beyond the end of a way, get a number without meaning.
    """
    real, whole = types.float32, types.int32
    signature = types.void(flat, whole, whole, real, real, real, real, real, real, levels)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        f32, i32, i64 = ir.FloatType(), ir.IntType(32), ir.IntType(64)
        floats, words = ir.VectorType(f32, LANES), ir.VectorType(i32, LANES)
        proxy: Any = cgutils.create_struct_proxy
        picture = proxy(signature.args[0])(context, builder, arguments[0]).data
        result = proxy(signature.args[-1])(context, builder, arguments[-1]).data

        def spread(value: Any, kind: Any) -> Any:
            one = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(i32, 0))
            return builder.shuffle_vector(
                one, ir.Constant(kind, ir.Undefined), ir.Constant(words, [0] * LANES)
            )

        def clamped(value: Any, most: Any) -> Any:
            least = ir.Constant(floats, [0.0] * LANES)
            value = builder.select(builder.fcmp_ordered("<", value, most), value, most)
            return builder.select(builder.fcmp_ordered(">", value, least), value, least)

        def pairs(at: Any) -> tuple[Any, Any]:
            """Values at places and to the right of them: one load of 64 bits each, the left one low."""
            long = ir.VectorType(i64, LANES)
            found: Any = ir.Constant(long, ir.Undefined)
            for lane in range(LANES):
                index = builder.extract_element(at, ir.Constant(i32, lane))
                place = builder.gep(picture, [builder.sext(index, i64)])
                two = builder.load(builder.bitcast(place, i64.as_pointer()))
                two.align = 4
                found = builder.insert_element(found, two, ir.Constant(i32, lane))
            left = builder.bitcast(builder.trunc(found, words), floats)
            shift = ir.Constant(long, [32] * LANES)
            right = builder.bitcast(builder.trunc(builder.lshr(found, shift), words), floats)
            return left, right

        _, width, height, x, y, dx, dy, more, grows, _ = arguments
        h = ir.Constant(floats, [float(f + 1) for f in range(LANES)])
        two = ir.Constant(i32, 2)
        along = []
        for start, step, size in ((x, dx, width), (y, dy, height)):
            place = builder.fadd(spread(start, floats), builder.fmul(h, spread(step, floats)))
            edge = spread(builder.sitofp(builder.sub(size, two), f32), floats)
            low = builder.fptosi(clamped(place, edge), words)
            along.append((low, builder.fsub(place, builder.sitofp(low, floats))))
        (i, a), (j, b) = along
        at = builder.add(builder.mul(j, spread(width, words)), i)
        v00, v01 = pairs(at)
        v10, v11 = pairs(builder.add(at, spread(width, words)))
        up = builder.fadd(v00, builder.fmul(a, builder.fsub(v01, v00)))
        low = builder.fadd(v10, builder.fmul(a, builder.fsub(v11, v10)))
        value = builder.fadd(up, builder.fmul(b, builder.fsub(low, up)))
        extra = builder.fadd(spread(more, floats), builder.fmul(h, spread(grows, floats)))
        stored = builder.store(builder.fadd(value, extra), builder.bitcast(result, floats.as_pointer()))
        stored.align = 4
        return context.get_dummy_value()

    return signature, generate


sample: Any = _sample
"""The same under a type that callers may call as a function."""
