"""Events of sixteen pixels along the samples of a chunk.

Crossings of thresholds are put in a queue as they come, sample by sample. Their times, which need a division
each, are worked out for sixteen crossings at once.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from carlaloc_env.sensors.event_camera.interpolation import can_pick
from carlaloc_env.sensors.event_camera.simd import I32, I64, LANES, WORDS, Room, Wide, all_of, data_of, spread
from carlaloc_env.sensors.event_camera.simd_state import (
    LEVELS,
    LOWER,
    OFF,
    ON,
    QUEUE_ROWS,
    REFERENCE,
    RISEN,
    ROSE,
    UPPER,
)

QUEUED, TIMES, CODES = 3, 3 + QUEUE_ROWS, 4 + QUEUE_ROWS
"""Rows of whole numbers: the queue's first; times and codes of sixteen crossings of it."""
MARK_ROWS = CODES + 1
"""Rows of whole numbers."""
REALS = ir.VectorType(ir.DoubleType(), LANES)
TRUTHS = ir.VectorType(ir.IntType(1), LANES)
_UP, _SAMPLE = 4, 5
"""Bits of a queue's word: above the lane that of a rise, above this the number of the sample before."""
_FULL = LANES * (QUEUE_ROWS - 2)


@intrinsic
def _volley(
    typing: Any, first: Any, stop: Any, before: Any, noisy: Any, queued: Any, lanes: Any, marks: Any
) -> Any:
    """Put all crossings of a chunk's samples in the queue, until one is of a noisy pixel or it is full.

    Args: number of the first sample in the chunk, from 1 on; number after the last one; samples before the
    chunk; noisy pixels as bits; crossings in the queue. Returns: number of the sample where it came to a
    halt, or `stop`, in the upper 32 bits; crossings in the queue, in the next 16; noisy pixels that the
    sample makes fire, in the lower 16; if there are none it is not done with, for the queue is full.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        first, stop, before, noisy, queued, _, _ = arguments
        room = Room(context, builder, signature.args[5], arguments[5])
        words = data_of(context, builder, signature.args[6], arguments[6])
        on, off = room[ON], room[OFF]
        one, none = ir.Constant(I32, 1), ir.Constant(I32, 0)
        loop, fires, shoots, shot, onward, done = (
            builder.append_basic_block(name)
            for name in ("sample", "fires", "shoots", "shot", "onward", "done")
        )
        begun = [room[UPPER].value, room[LOWER].value, room[REFERENCE].value, queued]
        entry = builder.block
        builder.cbranch(builder.icmp_signed("<", first, stop), loop, done)

        def phis(*kinds: Any) -> list[Any]:
            return [builder.phi(kind) for kind in kinds]

        held = [value.type for value in begun]
        builder.position_at_end(loop)
        step, *state = phis(I32, *held)
        upper, lower = Wide(builder, state[0]), Wide(builder, state[1])
        row = builder.add(ir.Constant(I32, LEVELS), step)
        level = room[row]
        bits = ((level >= upper) | (level <= lower)).bits()
        builder.cbranch(builder.icmp_unsigned("!=", bits, none), fires, onward)

        builder.position_at_end(fires)
        earlier = room[builder.sub(row, one)]
        rise = level - earlier
        sample = builder.sub(builder.add(before, step), one)
        word = spread(builder, builder.shl(sample, ir.Constant(I32, _SAMPLE))).value
        word = builder.or_(word, ir.Constant(WORDS, list(range(LANES))))
        quiet = builder.and_(bits, builder.not_(noisy))
        builder.cbranch(builder.icmp_unsigned("!=", quiet, none), shoots, shot)

        builder.position_at_end(shoots)
        firing, *now = phis(I32, *held)
        upper, lower, reference = (Wide(builder, value) for value in now[:3])
        which = Wide(builder, builder.bitcast(builder.trunc(firing, ir.IntType(LANES)), TRUTHS))
        positive = level >= upper
        crossed = positive.pick(upper, lower)
        sign = builder.shl(builder.zext(positive.value, WORDS), ir.Constant(WORDS, [_UP] * LANES))
        start = now[3]
        for place, values in (
            (room.at(RISEN, start), (crossed - earlier).value),
            (room.at(ROSE, start), rise.value),
            (
                builder.gep(words, [builder.add(ir.Constant(I32, QUEUED * LANES), start)]),
                builder.or_(word, sign),
            ),
        ):
            _put_close(context, builder, values, place, which.value)
        upper, lower = which.pick(crossed + on, upper), which.pick(crossed - off, lower)
        count = builder.add(start, builder.ctpop(firing))
        later = [upper.value, lower.value, which.pick(crossed, reference).value, count]
        again = (which & ((level >= upper) | (level <= lower))).bits()
        full = builder.icmp_signed(">", count, ir.Constant(I32, _FULL))
        ended = builder.append_basic_block("ended")
        more = builder.append_basic_block("more")
        builder.cbranch(full, ended, more)
        builder.position_at_end(more)
        builder.cbranch(builder.icmp_unsigned("!=", again, none), shoots, shot)
        builder.position_at_end(ended)
        builder.branch(done)
        for value, start_value, later_value in zip(
            [firing, *now], [quiet, *state], [again, *later], strict=True
        ):
            value.add_incoming(start_value, fires)
            value.add_incoming(later_value, more)

        builder.position_at_end(shot)
        left = phis(*held)
        for value, unchanged, changed in zip(left, state, later, strict=True):
            value.add_incoming(unchanged, fires)
            value.add_incoming(changed, more)
        heard = builder.and_(bits, noisy)
        builder.cbranch(builder.icmp_unsigned("!=", heard, none), done, onward)

        builder.position_at_end(onward)
        kept = phis(*held)
        for value, unchanged, changed in zip(kept, state, left, strict=True):
            value.add_incoming(unchanged, loop)
            value.add_incoming(changed, shot)
        following = builder.add(step, one)
        builder.cbranch(builder.icmp_signed("<", following, stop), loop, done)
        for value, at_first, after in zip([step, *state], [first, *begun], [following, *kept], strict=True):
            value.add_incoming(at_first, entry)
            value.add_incoming(after, onward)

        builder.position_at_end(done)
        at, loud, *final = phis(I32, I32, *held)
        for block, values in (
            (entry, (stop, none, *begun)),
            (ended, (step, none, *later)),
            (shot, (step, heard, *left)),
            (onward, (stop, none, *kept)),
        ):
            for value, incoming in zip([at, loud, *final], values, strict=True):
                value.add_incoming(incoming, block)
        for row, value in zip((UPPER, LOWER, REFERENCE), final[:3], strict=True):
            room[row] = Wide(builder, value)
        result = builder.shl(builder.zext(at, I64), ir.Constant(I64, 32))
        result = builder.or_(result, builder.shl(builder.zext(final[3], I64), ir.Constant(I64, 16)))
        return builder.or_(result, builder.zext(loud, I64))

    whole = types.int32
    return types.int64(whole, whole, whole, whole, whole, lanes, marks), generate


@intrinsic
def _timed(typing: Any, row: Any, sample_us: Any, span_us: Any, place: Any, lanes: Any, marks: Any) -> Any:
    """Work out times [µs] and codes of sixteen crossings of the queue.

    Args: which sixteen of it; time between two samples [µs]; length of the span [µs]; place of the first
    pixel, row in the upper 16 bits.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        row, sample_us, span_us, place, _, _ = arguments
        room = Room(context, builder, signature.args[4], arguments[4])
        words = data_of(context, builder, signature.args[5], arguments[5])

        def at(number: Any) -> Any:
            here = builder.mul(number, ir.Constant(I32, LANES))
            return builder.bitcast(builder.gep(words, [here]), WORDS.as_pointer())

        def every(number: int) -> Any:
            return ir.Constant(WORDS, [number] * LANES)

        word = builder.load(at(builder.add(ir.Constant(I32, QUEUED), row)))
        word.align = 4
        done, rise = (room[builder.add(ir.Constant(I32, first), row)] for first in (RISEN, ROSE))
        begin = builder.sitofp(builder.lshr(word, every(_SAMPLE)), REALS)
        t = _times(builder, done, rise, begin, sample_us, span_us)
        # A tile's pixels come in two rows of eight.
        down = builder.shl(builder.and_(builder.lshr(word, every(3)), every(1)), every(17))
        right = builder.shl(builder.and_(word, every(7)), every(1))
        sign = builder.and_(builder.lshr(word, every(_UP)), every(1))
        start = spread(builder, builder.shl(place, ir.Constant(I32, 1))).value
        code = builder.add(start, builder.or_(builder.or_(down, right), sign))
        for number, values in ((TIMES, t), (CODES, code)):
            builder.store(values, at(ir.Constant(I32, number))).align = 4
        return context.get_dummy_value()

    whole = types.int32
    return types.void(whole, types.float64, whole, whole, lanes, marks), generate


def _times(builder: Any, done: Wide, rise: Wide, begin: Any, sample_us: Any, span_us: Any) -> Any:
    """Times at which a signal has risen by `done` of its `rise` within a sample [µs], rounded up."""
    steady = Wide(builder, builder.fcmp_ordered("==", rise.value, (rise * 0.0).value))
    part = steady.pick(1.0, done / rise).most(0.0).least(1.0)
    samples = builder.fadd(builder.fpext(part.value, REALS), begin)
    kind = ir.FunctionType(REALS, [REALS])
    declared: Any = cgutils.get_or_insert_function
    ceiling = declared(builder.module, kind, f"llvm.ceil.v{LANES}f64")
    t = builder.call(ceiling, [builder.fmul(samples, all_of(builder, sample_us, REALS))])
    t, one = builder.fptosi(t, WORDS), ir.Constant(WORDS, [1] * LANES)
    t = builder.select(builder.icmp_signed(">", t, one), t, one)
    longest = spread(builder, span_us).value
    return builder.select(builder.icmp_signed("<", t, longest), t, longest)


def _put_close(context: Any, builder: Any, values: Any, place: Any, which: Any) -> None:
    """Write those of sixteen numbers one after another; what lies behind them may change."""
    declared: Any = cgutils.get_or_insert_function
    suffix, pointer = ("f32" if values.type.element != I32 else "i32"), values.type.element.as_pointer()
    if not can_pick(context):
        kind = ir.FunctionType(ir.VoidType(), [values.type, pointer, TRUTHS])
        store = declared(builder.module, kind, f"llvm.masked.compressstore.v{LANES}{suffix}")
        builder.call(store, [values, place, which])
        return
    kind = ir.FunctionType(values.type, [values.type, values.type, TRUTHS])
    close = declared(builder.module, kind, f"llvm.x86.avx512.mask.compress.v{LANES}{suffix}")
    moved = builder.call(close, [values, values, which])
    builder.store(moved, builder.bitcast(place, values.type.as_pointer())).align = 4


# Under a type that callers may call as functions.
volley: Any = _volley
timed: Any = _timed
