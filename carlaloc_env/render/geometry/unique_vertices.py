"""Vertices that are equal in every attribute, made one: levels of detail share what they have in common."""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import U32
from carlaloc_env.core.jit import compiled

_FACTOR = 0x9E3779B97F4A7C15
"""Odd number near 2⁶⁴ divided by the golden ratio, by which hashes are mixed (Knuth, TAOCP 3, 6.4)."""


def without_doubles(vertices: NDArray[np.void], triangles: U32) -> tuple[NDArray[np.void], U32]:
    """The first of all equal vertices, in their order, and the triangles between these.

    Args:
        vertices: Packed vertices of a whole number of 32-bit words, shape (V,).
        triangles: Corner indices, shape (T, 3).

    Returns:
        Vertices of which no two have the same bytes, shape (U,), and triangles, shape (T, 3).
    """
    words = vertices.view(np.uint32).reshape(len(vertices), vertices.itemsize // 4)
    number, kept = np.empty(len(vertices), np.uint32), np.empty(len(vertices), np.uint32)
    # Half of a hash table stays empty, so that most searches end at once. It is freed right after.
    count = _number(words, np.zeros(1 << (2 * len(vertices)).bit_length(), np.uint32), number, kept)
    return vertices[kept[:count]], np.take(number, triangles)


@compiled
def _number(words: U32, slots: U32, number: U32, kept: U32) -> int:
    """Number different rows by their first appearance, and count them.

    Args:
        words: Rows, shape (V, W).
        slots: Zeros, more than V, a power of two; becomes a hash table of numbers plus one.
        number: Receives the number of each row, shape (V,).
        kept: Receives the first row of each number, shape (V,).
    """
    count, last = 0, np.uint64(len(slots) - 1)
    for v in range(len(words)):
        key = np.uint64(0)
        for w in range(words.shape[1]):
            key = (key ^ np.uint64(words[v, w])) * np.uint64(_FACTOR)
            key ^= key >> np.uint64(29)
        at = key & last
        while True:
            other = slots[at]
            if other == 0:
                kept[count], number[v] = v, count
                count += 1
                slots[at] = count
                break
            equal = True
            for w in range(words.shape[1]):
                equal = equal and words[kept[other - 1], w] == words[v, w]
            if equal:
                number[v] = other - 1
                break
            at = (at + np.uint64(1)) & last
    return count
