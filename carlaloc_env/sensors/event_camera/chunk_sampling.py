"""Sixteen pixels of a smooth tile on their straight way through a chunk of samples, in one picture.

The pixels that a sample looks at lie close to each other. Where a chunk's ends show that four rows of
sixteen columns, moving along with them, always hold them all, they are picked from these rows.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic

from carlaloc_env.sensors.event_camera.interpolation import between, can_pick, mixed, pick
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
from carlaloc_env.sensors.event_camera.simd_state import (
    BEGIN,
    DRIFT,
    DX,
    DY,
    END,
    FIRST_SAYS,
    GROWS,
    LEVELS,
    MORE,
    SIGNAL,
    WINDOW,
    X,
    Y,
)

ANYWHERE, FOUR_ROWS, THREE_ROWS = 0, 1, 2
"""Where the pixels of all samples of a chunk lie: in rows that move along with them, or not."""
_SLACK_PX = 1 / 256
"""More than rounding moves a place [px]."""
_COLUMNS_PX = 13.9
"""Places farther apart do not always fit into sixteen columns with their right neighbours [px]."""
_HALF = LANES // 2


@intrinsic
def _follow(
    typing: Any, second: Any, share: Any, begun: Any, per_step: Any, width: Any, height: Any, lanes: Any
) -> Any:
    """Follow the first or the second picture through a chunk; what the other says more goes linearly.

    Args: 0 or 1, which picture; 1 / samples of the chunk; share of the time before it; share of one
    sample; the picture's size. Returns: where the pixels lie.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        room = Room(context, builder, signature.args[6], arguments[6])
        second, size = arguments[0], arguments[4:6]
        share, begun, per_step = (spread(builder, a) for a in arguments[1:4])

        def row(end: int, part: Any, more: int = 0) -> Wide:
            return room[builder.add(ir.Constant(I32, end + more), part)]

        twice = builder.add(second, second)
        ends = []
        for part, (at, step) in enumerate(((X, DX), (Y, DY))):
            start, stop = row(BEGIN, twice, part), row(END, twice, part)
            ends += [start, stop]
            room[at], room[step] = start, share * (stop - start)
        above = room[BEGIN + SIGNAL] - row(BEGIN, second, FIRST_SAYS)
        later = room[END + SIGNAL] - row(END, second, FIRST_SAYS)
        leaked = room[DRIFT] * begun
        room[MORE] = above + leaked
        room[GROWS] = (later - above) * share + room[DRIFT] * per_step
        room[LEVELS] = room[BEGIN + SIGNAL] + leaked
        if not can_pick(context):
            return ir.Constant(I32, ANYWHERE)
        return _window(builder, ends, size, share, room)

    real, whole = types.float32, types.int32
    return whole(whole, real, real, real, whole, whole, lanes), generate


def _window(builder: Any, ends: list[Wide], size: tuple[Any, Any], share: Wide, room: Room) -> Any:
    """Note how the rows and columns go along that hold the pixels; how many rows they are, i32.

    Args:
        builder: Of the code around.
        ends: Places x at the beginning and at the end of a chunk, and y.
        size: Width and height of the picture.
        share: 1 / samples of the chunk.
        room: Where to note it.
    """

    def shuffled(one: Wide, other: Wide, order: list[int]) -> Wide:
        return Wide(builder, builder.shuffle_vector(one.value, other.value, ir.Constant(WORDS, order)))

    # Ways are bilinear in a pixel's place, so that those of the corners hold all others between them.
    corners = [0, 7, 8, 15]
    four = [*corners, *(LANES + c for c in corners)]
    both = [*range(_HALF), *range(LANES, LANES + _HALF)]
    x, y = (shuffled(ends[k], ends[k + 1], four + four) for k in (0, 2))
    low = high = shuffled(x, y, both)
    for bit in (1, 2):
        order = [lane ^ bit for lane in range(LANES)]
        low, high = low.least(shuffled(low, low, order)), high.most(shuffled(high, high, order))
    begin = low - _SLACK_PX
    later = shuffled(low, low, [(lane + 4) % LANES for lane in range(LANES)])
    room[WINDOW], room[WINDOW + 1] = begin, share * (later - low)

    def halves(along: float, down: float) -> Wide:
        return Wide(builder, ir.Constant(FLOATS, [along] * _HALF + [down] * _HALF))

    edges = (builder.sitofp(builder.sub(n, ir.Constant(I32, 2)), F32) for n in size)
    right, bottom = (spread(builder, edge) for edge in edges)
    inside = (low >= 2 * _SLACK_PX) & (high <= shuffled(right, bottom, both) - 2 * _SLACK_PX)
    apart = high - low
    fits = [(inside & (apart <= halves(_COLUMNS_PX, rows - 2 * _SLACK_PX))).bits() for rows in (2, 1)]
    every = ir.Constant(I32, (1 << LANES) - 1)
    large = builder.and_(*(builder.icmp_signed(">=", n, ir.Constant(I32, LANES)) for n in size))
    some = builder.and_(large, builder.icmp_unsigned("==", fits[0], every))
    few = builder.icmp_unsigned("==", fits[1], every)
    rows = builder.select(few, ir.Constant(I32, THREE_ROWS), ir.Constant(I32, FOUR_ROWS))
    return builder.select(some, rows, ir.Constant(I32, ANYWHERE))


@intrinsic
def _travel(typing: Any, flat: Any, width: Any, height: Any, where: Any, stop: Any, lanes: Any) -> Any:
    """Note the signal at all samples of a chunk.

    Args: the picture (H·W,) and its size, where the pixels lie, number of the sample after the last one
    (those of a chunk count from 1).
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        picture = data_of(context, builder, signature.args[0], arguments[0])
        _, width, height, where, stop, _ = arguments
        room = Room(context, builder, signature.args[5], arguments[5])

        def seen_anywhere(step: Any, x: Wide, y: Wide) -> Wide:
            return between(context, builder, picture, width, height, x, y)

        def seen_within(rows: int) -> Callable[[Any, Wide, Wide], Wide]:
            window = []
            for lane, size, need in ((0, width, LANES), (_HALF, height, rows)):
                place, along = (
                    builder.extract_element(room[WINDOW + k].value, ir.Constant(I32, lane)) for k in (0, 1)
                )
                window.append((place, along, builder.sub(size, ir.Constant(I32, need))))

            def seen(step: Any, x: Wide, y: Wide) -> Wide:
                starts = []
                for place, along, last in window:
                    at = builder.fptosi(builder.fadd(place, builder.fmul(step, along)), I32)
                    starts.append(builder.select(builder.icmp_signed("<", at, last), at, last))
                return _seen_in_rows(builder, picture, width, starts, rows, x, y)

            return seen

        end = builder.append_basic_block("end")
        starts = {ANYWHERE: builder.append_basic_block("anywhere")}
        if can_pick(context):
            starts |= {kind: builder.append_basic_block(f"rows_{kind}") for kind in (THREE_ROWS, FOUR_ROWS)}
        switch = builder.switch(where, starts[ANYWHERE])
        for kind, block in starts.items():
            if kind != ANYWHERE:
                switch.add_case(ir.Constant(I32, kind), block)
            builder.position_at_end(block)
            seen = seen_anywhere if kind == ANYWHERE else seen_within(3 if kind == THREE_ROWS else 4)
            _samples(builder, room, seen, stop, end)
        builder.position_at_end(end)
        return context.get_dummy_value()

    whole = types.int32
    return types.void(flat, whole, whole, whole, whole, lanes), generate


def _samples(builder: Any, room: Room, seen: Callable[[Any, Wide, Wide], Wide], stop: Any, end: Any) -> None:
    """A loop over samples, which goes to a block `end`."""
    # Read once: the compiler cannot know that what the loop writes lies elsewhere.
    x, dx, y, dy, more, grows = (room[row] for row in (X, DX, Y, DY, MORE, GROWS))
    before, loop = builder.block, builder.append_basic_block("sample")
    one = ir.Constant(I32, 1)
    builder.cbranch(builder.icmp_signed("<", one, stop), loop, end)
    builder.position_at_end(loop)
    step = builder.phi(I32)
    real = builder.sitofp(step, F32)
    h = spread(builder, real)
    row = builder.add(ir.Constant(I32, LEVELS), step)
    room[row] = seen(real, x + h * dx, y + h * dy) + (more + h * grows)
    following = builder.add(step, one)
    step.add_incoming(one, before)
    step.add_incoming(following, builder.block)
    builder.cbranch(builder.icmp_signed("<", following, stop), loop, end)


def _seen_in_rows(
    builder: Any, picture: Any, width: Any, starts: list[Any], rows: int, x: Wide, y: Wide
) -> Wide:
    """Bilinear values at places in some rows of sixteen pixels of a picture, from (column, row) on."""
    left, top = starts
    i, j = x.words(), y.words()
    first = builder.add(left, builder.shl(top, ir.Constant(I32, 4)))
    at = builder.add(builder.shl(j, ir.Constant(WORDS, [4] * LANES)), i)
    at = builder.sub(at, spread(builder, first).value)
    start = builder.gep(picture, [builder.sext(builder.add(builder.mul(top, width), left), I64)])
    values = pick(builder, start, builder.sext(width, I64), rows, at)
    return mixed(builder, values, x, y, i, j)


# Under a type that callers may call as functions.
follow: Any = _follow
travel: Any = _travel
