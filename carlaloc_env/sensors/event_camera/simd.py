"""Sixteen pixels side by side: arithmetic in the compiler's own vector operations.

Only + − × ÷, comparisons and conversions, none contracted, so the bits are those of the same sums
one by one, on every machine.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

LANES = 16
"""Pixels worked on at once."""
F32, I32, I64 = ir.FloatType(), ir.IntType(32), ir.IntType(64)
FLOATS, WORDS = ir.VectorType(F32, LANES), ir.VectorType(I32, LANES)


class Wide:
    """Sixteen numbers of 32 bits, or sixteen truths."""

    __slots__ = ("builder", "value")

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder, self.value = builder, value

    def _like(self, other: Any) -> Any:
        if isinstance(other, Wide):
            return other.value
        return ir.Constant(self.value.type, [other] * LANES)

    def __add__(self, other: Any) -> Wide:
        return Wide(self.builder, self.builder.fadd(self.value, self._like(other)))

    def __sub__(self, other: Any) -> Wide:
        return Wide(self.builder, self.builder.fsub(self.value, self._like(other)))

    def __mul__(self, other: Any) -> Wide:
        return Wide(self.builder, self.builder.fmul(self.value, self._like(other)))

    def __truediv__(self, other: Any) -> Wide:
        return Wide(self.builder, self.builder.fdiv(self.value, self._like(other)))

    def __lt__(self, other: Any) -> Wide:
        return Wide(self.builder, self.builder.fcmp_ordered("<", self.value, self._like(other)))

    def __le__(self, other: Any) -> Wide:
        return Wide(self.builder, self.builder.fcmp_ordered("<=", self.value, self._like(other)))

    def __gt__(self, other: Any) -> Wide:
        return Wide(self.builder, self.builder.fcmp_ordered(">", self.value, self._like(other)))

    def __ge__(self, other: Any) -> Wide:
        return Wide(self.builder, self.builder.fcmp_ordered(">=", self.value, self._like(other)))

    def __and__(self, other: Wide) -> Wide:
        return Wide(self.builder, self.builder.and_(self.value, other.value))

    def __or__(self, other: Wide) -> Wide:
        return Wide(self.builder, self.builder.or_(self.value, other.value))

    def __invert__(self) -> Wide:
        return Wide(self.builder, self.builder.not_(self.value))

    def pick(self, yes: Any, no: Any) -> Wide:
        """One of two numbers, by truth; one of them must be `Wide`."""
        first = yes if isinstance(yes, Wide) else Wide(self.builder, no._like(yes))
        return Wide(self.builder, self.builder.select(self.value, first.value, first._like(no)))

    def least(self, other: Any) -> Wide:
        """The smaller of two."""
        return self.__lt__(other).pick(self, other)

    def most(self, other: Any) -> Wide:
        """The greater of two."""
        return self.__gt__(other).pick(self, other)

    def size(self) -> Wide:
        """Without its sign."""
        return (self < 0.0).pick(self * -1.0, self)

    def whole(self) -> Wide:
        """Rounded towards zero, as a float."""
        return Wide(self.builder, self.builder.sitofp(self.words(), FLOATS))

    def words(self) -> Any:
        """Rounded towards zero, as integers."""
        return self.builder.fptosi(self.value, WORDS)

    def bits(self) -> Any:
        """Truths as bits of one integer."""
        short = self.builder.bitcast(self.value, ir.IntType(LANES))
        return self.builder.zext(short, I32)


class Room:
    """The numbers that kernels keep of sixteen pixels: rows of sixteen in one array."""

    def __init__(self, context: Any, builder: Any, kind: Any, array: Any) -> None:
        self.builder = builder
        self.data = data_of(context, builder, kind, array)

    def _place(self, row: Any) -> Any:
        row = ir.Constant(I64, row) if isinstance(row, int) else self.builder.sext(row, I64)
        at = self.builder.mul(row, ir.Constant(I64, LANES))
        return self.builder.bitcast(self.builder.gep(self.data, [at]), FLOATS.as_pointer())

    def at(self, row: int, lane: Any) -> Any:
        """Pointer to a number, `lane` (i32) on from the beginning of a row."""
        at = self.builder.add(ir.Constant(I32, row * LANES), lane)
        return self.builder.gep(self.data, [self.builder.sext(at, I64)])

    def __getitem__(self, row: Any) -> Wide:
        value = self.builder.load(self._place(row))
        value.align = 4
        return Wide(self.builder, value)

    def __setitem__(self, row: Any, value: Wide) -> None:
        self.builder.store(value.value, self._place(row)).align = 4


def data_of(context: Any, builder: Any, kind: Any, array: Any) -> Any:
    """Pointer to the numbers of an array."""
    proxy: Any = cgutils.create_struct_proxy
    return proxy(kind)(context, builder, array).data


def spread(builder: Any, value: Any) -> Wide:
    """One number in all lanes."""
    return Wide(builder, all_of(builder, value, FLOATS if value.type == F32 else WORDS))


def all_of(builder: Any, value: Any, kind: Any) -> Any:
    """One number in all lanes of a kind of vector."""
    none = ir.Constant(kind, ir.Undefined)
    one = builder.insert_element(none, value, ir.Constant(I32, 0))
    return builder.shuffle_vector(one, none, ir.Constant(WORDS, [0] * LANES))


def within(place: Wide, size: Any) -> Wide:
    """Whole part of a place between pixels, so that it and the next are in a row of `size` pixels."""
    builder = place.builder
    edge = spread(builder, builder.sitofp(builder.sub(size, ir.Constant(I32, 2)), F32))
    return place.least(edge).most(0.0)


def cells_at(builder: Any, field: Any, at: Any) -> list[Any]:
    """Pointers to the four numbers that a field (H·W·4,) holds of each of sixteen pixels."""
    allocated: Any = cgutils.alloca_once
    room = allocated(builder, WORDS)
    builder.store(builder.shl(at, ir.Constant(WORDS, [2] * LANES)), room)
    words = builder.bitcast(room, I32.as_pointer())
    # By way of memory, which the compiler must not see through: to take one after another out of a
    # register keeps the only unit busy that can also shuffle.
    hidden = ir.FunctionType(ir.VoidType(), [words.type])
    builder.asm(hidden, "", "r,~{memory}", [words], True)
    places = (builder.load(builder.gep(words, [ir.Constant(I32, lane)])) for lane in range(LANES))
    return [builder.gep(field, [builder.zext(place, I64)]) for place in places]


def neighbours(builder: Any, cells: list[Any], further: Any) -> tuple[list[Wide], list[Wide]]:
    """Four numbers each of pixels `further` (i64) on from `cells_at`, and those of the pixels right of them.

    One load of 256 bits for each, then turned round.
    """
    eight = ir.VectorType(F32, 8)

    def loaded(lane: int) -> Any:
        place = builder.gep(cells[lane], [further])
        value = builder.load(builder.bitcast(place, eight.as_pointer()))
        value.align = 4
        return value

    def shuffled(one: Any, other: Any, order: list[int]) -> Any:
        return builder.shuffle_vector(one, other, ir.Constant(ir.VectorType(I32, len(order)), order))

    def woven(one: Any, other: Any, pattern: tuple[int, int, int, int]) -> Any:
        # In every four numbers: those below 4 come from `one`, the others from `other`.
        return shuffled(
            one,
            other,
            [4 * block + p if p < 4 else LANES + 4 * block + p - 4 for block in range(4) for p in pattern],
        )

    low, high, first, second = (0, 4, 1, 5), (2, 6, 3, 7), (0, 1, 4, 5), (2, 3, 6, 7)
    turned = []
    for begin in (0, 8):
        # Fours of numbers: a pixel, the one right of it, the pixel four lanes on, the one right of that.
        q = [shuffled(loaded(begin + n), loaded(begin + n + 4), list(range(LANES))) for n in range(4)]
        t0, t1 = woven(q[0], q[1], low), woven(q[2], q[3], low)
        t2, t3 = woven(q[0], q[1], high), woven(q[2], q[3], high)
        turned.append(
            (woven(t0, t1, first), woven(t0, t1, second), woven(t2, t3, first), woven(t2, t3, second))
        )
    sides = []
    for side in (0, 4):
        order = [base + block + n for base in (0, LANES) for block in (side, side + 8) for n in range(4)]
        sides.append([Wide(builder, shuffled(one, other, order)) for one, other in zip(*turned, strict=True)])
    return sides[0], sides[1]


@intrinsic
def _word_of(typing: Any, value: Any) -> Any:
    """The bits of a float as an integer."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], I32)

    return types.int32(types.float32), generate


@intrinsic
def _float_of(typing: Any, word: Any) -> Any:
    """The float of some bits."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], F32)

    return types.float32(types.int32), generate


# Under a type that callers may call as functions.
word_of: Any = _word_of
float_of: Any = _float_of
