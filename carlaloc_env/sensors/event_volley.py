"""Events of all those of sixteen pixels at once whose signal crosses one threshold each."""

from __future__ import annotations

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from carlaloc_env.sensors.event_lanes import I32, I64, LANES, WORDS, Room, Wide, all_of, data_of, spread
from carlaloc_env.sensors.event_sampling import EARLIER, LEVEL, LOWER, OFF, ON, REFERENCE, UPPER

REALS = ir.VectorType(ir.DoubleType(), LANES)
TRUTHS = ir.VectorType(ir.IntType(1), LANES)


@intrinsic
def _volley(
    typing: Any,
    bits: Any,
    begin: Any,
    sample_us: Any,
    span_us: Any,
    refractory_us: Any,
    place: Any,
    last: Any,
    lanes: Any,
    out_t: Any,
    out_code: Any,
    count: Any,
) -> Any:
    """Fire those of sixteen pixels once; number of events in the upper bits, in the lower 16 who fires again.

    Args: the pixels; number of the sample before this one; time between two samples [µs]; length of the
    span [µs]; shortest time between two events [µs]; place of the first pixel, row in the upper 16 bits;
    array that begins with times of their last events [µs]; their numbers; times and codes of all events,
    with room for sixteen more, and how many there are.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        bits, begin, sample_us, span_us, refractory_us, first, _, _, _, _, count = arguments
        room = Room(context, builder, signature.args[7], arguments[7])
        level, earlier = room[LEVEL], room[EARLIER]
        firing = Wide(builder, builder.bitcast(builder.trunc(bits, ir.IntType(LANES)), TRUTHS))
        positive = level >= room[UPPER]
        crossed = positive.pick(room[UPPER], room[LOWER])
        upper, lower = crossed + room[ON], crossed - room[OFF]
        again = (firing & ((level >= upper) | (level <= lower))).bits()
        t = _times(builder, crossed - earlier, level - earlier, begin, sample_us, span_us)
        for row, value in ((REFERENCE, crossed), (UPPER, upper), (LOWER, lower)):
            room[row] = firing.pick(value, room[row])
        data = data_of(context, builder, signature.args[6], arguments[6])
        moments = builder.bitcast(data, WORDS.as_pointer())
        last = builder.load(moments)
        last.align = 4
        since = builder.sub(t, last)
        rested = builder.icmp_signed(">=", since, spread(builder, refractory_us).value)
        heard = firing & Wide(builder, rested)
        builder.store(builder.select(heard.value, t, last), moments).align = 4
        offsets = ir.Constant(WORDS, [(lane // 8 << 16) + lane % 8 for lane in range(LANES)])
        code = builder.add(offsets, spread(builder, first).value)
        sign = builder.zext(positive.value, WORDS)
        code = builder.or_(builder.shl(code, ir.Constant(WORDS, [1] * LANES)), sign)
        for k, values in ((8, t), (9, code)):
            data = data_of(context, builder, signature.args[k], arguments[k])
            _put_close(builder, values, builder.gep(data, [count]), heard.value)
        fired = builder.zext(builder.ctpop(heard.bits()), I64)
        return builder.or_(builder.shl(fired, ir.Constant(I64, 16)), builder.zext(again, I64))

    whole, real = types.int32, types.float64
    return types.int64(
        whole, real, real, whole, whole, whole, last, lanes, out_t, out_code, types.int64
    ), generate


def _times(builder: Any, done: Wide, rise: Wide, begin: Any, sample_us: Any, span_us: Any) -> Any:
    """Times at which a signal has risen by `done` of its `rise` within a sample [µs], rounded up."""
    steady = Wide(builder, builder.fcmp_ordered("==", rise.value, (rise * 0.0).value))
    part = steady.pick(1.0, done / rise).most(0.0).least(1.0)
    samples = builder.fadd(builder.fpext(part.value, REALS), all_of(builder, begin, REALS))
    kind = ir.FunctionType(REALS, [REALS])
    declared: Any = cgutils.get_or_insert_function
    ceiling = declared(builder.module, kind, f"llvm.ceil.v{LANES}f64")
    t = builder.call(ceiling, [builder.fmul(samples, all_of(builder, sample_us, REALS))])
    t, one = builder.fptosi(t, WORDS), ir.Constant(WORDS, [1] * LANES)
    t = builder.select(builder.icmp_signed(">", t, one), t, one)
    longest = spread(builder, span_us).value
    return builder.select(builder.icmp_signed("<", t, longest), t, longest)


def _put_close(builder: Any, values: Any, place: Any, which: Any) -> None:
    """Write those of sixteen numbers one after another."""
    kind = ir.FunctionType(ir.VoidType(), [WORDS, I32.as_pointer(), TRUTHS])
    declared: Any = cgutils.get_or_insert_function
    store = declared(builder.module, kind, f"llvm.masked.compressstore.v{LANES}i32")
    builder.call(store, [values, place, which])


# Under a type that callers may call as a function.
volley: Any = _volley
