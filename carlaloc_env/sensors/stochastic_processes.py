"""Sensor noise as pure functions of (seed, name, stamp)."""

import math
from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import clock, elementary
from carlaloc_env.core.array_types import Array

_BLOCK = 200
"""Samples whose numbers are drawn at once."""
_SLOW_NS = 30_000_000_000
"""Time between two values of a slow process [ns]."""
_FLICKER_TIMES_S = (3.0, 30.0, 300.0, 3000.0)
"""Correlation times whose sum is flat in the Allan plot over three decades [s]."""
_FLICKER_LEVEL = 0.7631
"""Mean of the Allan deviation between 10 s and 1000 s of the sum of these processes at unit variance."""


def white_noise(seed: int, name: str, stamp_ns: int, count: int) -> Array:
    """Standard normal numbers of one sample, shape (count,)."""
    return clock.stream(seed, name, stamp_ns).standard_normal(count)


class _Blocks(ABC):
    """Rows of numbers by sample number, made in blocks; any number in any order."""

    def __init__(self, width: int) -> None:
        self._width = width
        self._newest: tuple[int, Array] | None = None

    @abstractmethod
    def block(self, block: int) -> Array:
        """All rows of a block, shape (at least block length, width)."""

    def rows(self, numbers: NDArray[np.int64]) -> Array:
        """Rows of the given sample numbers (M,), shape (M, width)."""
        out = np.empty((len(numbers), self._width))
        blocks = numbers // _BLOCK
        for block in np.unique(blocks):
            mine = blocks == block
            if self._newest is None or self._newest[0] != block:
                self._newest = int(block), self.block(int(block))
            out[mine] = self._newest[1][numbers[mine] - block * _BLOCK]
        return out


class WhiteSequence(_Blocks):
    """Standard normal rows of a fast sensor by sample number, drawn in blocks.

    Row n depends on (seed, name, n) alone; blocks only save the making of generators.
    """

    def __init__(self, seed: int, name: str, width: int) -> None:
        super().__init__(width)
        self._seed, self._name = seed, name
        self._held: dict[int, Array] = {}

    def block(self, block: int) -> Array:
        """All rows of one block, shape (block length, width)."""
        if block not in self._held:
            if len(self._held) >= 8:
                self._held.pop(next(iter(self._held)))
            generator = clock.stream(self._seed, self._name, index=block)
            self._held[block] = generator.standard_normal((_BLOCK, self._width))
        return self._held[block]


class RandomWalk(_Blocks):
    """Running sum of unit steps by sample number, zero at sample 0.

    The sum at n is the sum of all earlier blocks' totals, always added in the same order, plus the
    part of n's block before it, so that a jump to n gives the same bytes as walking there.
    """

    def __init__(self, seed: int, name: str, width: int) -> None:
        super().__init__(width)
        self._steps = WhiteSequence(seed, name, width)
        self._before = [np.zeros(width)]

    def block(self, block: int) -> Array:
        """Values at a block's samples and at the one after, shape (block length + 1, width)."""
        while len(self._before) <= block:
            self._before.append(self._before[-1] + self._partial(len(self._before) - 1)[-1])
        partial = np.concatenate([np.zeros((1, self._width)), self._partial(block)])
        values: Array = self._before[block] + partial
        return values

    def _partial(self, block: int) -> Array:
        result: Array = np.cumsum(self._steps.block(block), axis=0)
        return result


class GaussMarkov(_Blocks):
    """First-order Gauss–Markov processes of unit variance by sample number.

    x[n] = φ·x[n−1] + √(1 − φ²)·w[n] with φ = exp(−Δt/τ) keeps its variance from the first sample on.
    Ends of blocks are chained in their order, so that a jump to n gives the same bytes as walking there.
    """

    def __init__(self, seed: int, name: str, width: int, *, period_s: float, time_constant_s: float) -> None:
        super().__init__(width)
        self._steps = WhiteSequence(seed, name, width)
        self._phi = float(elementary.exp(-period_s / time_constant_s))
        self._gain = math.sqrt(1.0 - self._phi * self._phi)
        self._ends = [clock.stream(seed, f"{name}/start").standard_normal(width)]

    def block(self, block: int) -> Array:
        """Values at a block's samples, shape (block length, width)."""
        while len(self._ends) <= block:
            self._ends.append(self._walk(len(self._ends) - 1)[-1])
        return self._walk(block)

    def _walk(self, block: int) -> Array:
        drive = self._gain * self._steps.block(block)
        # Here, since scipy.signal takes a second to import, and rigs are read without it.
        from scipy.signal import lfilter

        values, _ = lfilter([1.0], [1.0, -self._phi], drive, axis=0, zi=self._phi * self._ends[block][None])
        result: Array = values
        return result


class SlowMarkov:
    """Gauss–Markov processes of unit variance for any time: a value each 30 s, straight lines between."""

    def __init__(self, seed: int, name: str, width: int, *, time_constant_s: float) -> None:
        self._values = GaussMarkov(
            seed, name, width, period_s=_SLOW_NS * 1e-9, time_constant_s=time_constant_s
        )

    def at(self, stamp_ns: int) -> tuple[Array, Array]:
        """Values and their rates [1/s] at a stamp [ns], shape (width,) each."""
        number, part = divmod(stamp_ns, _SLOW_NS)
        before, after = self._values.rows(np.array([number, number + 1]))
        return before + (after - before) * (part / _SLOW_NS), (after - before) / (_SLOW_NS * 1e-9)


class EventCount(_Blocks):
    """Number of rare events up to a sample number, the sample included; events are independent.

    Args:
        probability: That of an event at a sample.
    """

    def __init__(self, seed: int, name: str, width: int, *, probability: float) -> None:
        super().__init__(width)
        self._seed, self._name, self._probability = seed, name, probability
        self._before = [np.zeros(width)]

    def block(self, block: int) -> Array:
        """Counts at a block's samples, shape (block length, width)."""
        while len(self._before) <= block:
            self._before.append(self._before[-1] + self._counts(len(self._before) - 1)[-1])
        counts: Array = self._before[block] + self._counts(block)
        return counts

    def _counts(self, block: int) -> Array:
        draw = clock.stream(self._seed, self._name, index=block).random((_BLOCK, self._width))
        counts: Array = np.cumsum(draw < self._probability, axis=0).astype(np.float64)
        return counts


class Flicker:
    """Bias instability: a flat stretch of the Allan deviation at 0.664·B, of unit B.

    1/f noise as a sum of Gauss–Markov processes a decade apart (Keshner, "1/f noise", Proc. IEEE 70,
    1982).
    """

    def __init__(self, seed: int, name: str, width: int, *, period_s: float) -> None:
        self._parts = [
            GaussMarkov(seed, f"{name}/{time_s:g}", width, period_s=period_s, time_constant_s=time_s)
            for time_s in _FLICKER_TIMES_S
        ]

    def rows(self, numbers: NDArray[np.int64]) -> Array:
        """Values at the given sample numbers (M,), shape (M, width)."""
        total: Array = self._parts[0].rows(numbers)
        for part in self._parts[1:]:
            total = total + part.rows(numbers)
        return (0.664 / _FLICKER_LEVEL) * total
