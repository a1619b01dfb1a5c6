"""Sensor noise as pure functions of (seed, name, stamp)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env import rng

Array = NDArray[np.float64]

_BLOCK = 200
"""Samples whose numbers are drawn at once."""


def white(seed: int, name: str, stamp_ns: int, count: int) -> Array:
    """Standard normal numbers of one sample, shape (count,)."""
    return rng.stream(seed, name, stamp_ns).standard_normal(count)


class WhiteSequence:
    """Standard normal rows of a fast sensor by sample number, drawn in blocks.

    Row n depends on (seed, name, n) alone; blocks only save the making of generators.
    """

    def __init__(self, seed: int, name: str, width: int) -> None:
        self._seed, self._name, self._width = seed, name, width
        self._held: dict[int, Array] = {}

    def rows(self, numbers: NDArray[np.int64]) -> Array:
        """Rows of the given sample numbers (M,), shape (M, width)."""
        out = np.empty((len(numbers), self._width))
        blocks = numbers // _BLOCK
        for block in np.unique(blocks):
            mine = blocks == block
            out[mine] = self.block(int(block))[numbers[mine] - block * _BLOCK]
        return out

    def block(self, block: int) -> Array:
        """All rows of one block, shape (block length, width)."""
        if block not in self._held:
            if len(self._held) >= 8:
                self._held.pop(next(iter(self._held)))
            generator = rng.stream(self._seed, self._name, index=block)
            self._held[block] = generator.standard_normal((_BLOCK, self._width))
        return self._held[block]


class RandomWalk:
    """Running sum of unit steps by sample number, zero at sample 0; any number in any order.

    The sum at n is the sum of all earlier blocks' totals, always added in the same order, plus the
    part of n's own block, so that a jump to n gives the same bytes as walking there.
    """

    def __init__(self, seed: int, name: str, width: int) -> None:
        self._steps = WhiteSequence(seed, name, width)
        self._before = [np.zeros(width)]
        self._width = width

    def rows(self, numbers: NDArray[np.int64]) -> Array:
        """Values at the given sample numbers (M,), shape (M, width)."""
        out = np.empty((len(numbers), self._width))
        blocks = numbers // _BLOCK
        for block in np.unique(blocks):
            while len(self._before) <= block:
                self._before.append(self._before[-1] + self._partial(len(self._before) - 1)[-1])
            mine = blocks == block
            partial = np.concatenate([np.zeros((1, self._width)), self._partial(int(block))])
            out[mine] = self._before[block] + partial[numbers[mine] - block * _BLOCK]
        return out

    def _partial(self, block: int) -> Array:
        result: Array = np.cumsum(self._steps.block(block), axis=0)
        return result
