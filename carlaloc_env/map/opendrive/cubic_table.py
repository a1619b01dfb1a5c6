"""Many cubic profiles in one table, evaluated for arrays of (owner, s) at once."""

from collections.abc import Sequence

import numpy as np

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.map.opendrive.records import Cubic


def last_at_or_before(first: Index, count: Index, starts: Array, s: Array) -> Index:
    """Row of the last start ≤ s among each query's own rows; the first row if none is.

    Args:
        first: First row of each query's own rows, (M,).
        count: Number of its own rows, at least one, (M,).
        starts: Ascending within each owner, all rows, (R,).
        s: What is looked up, (M,).
    """
    low = first.copy()
    # Most owners have a single row; only the others are searched.
    many = np.flatnonzero(count > 1)
    if not len(many):
        return low
    s = s[many]
    at, end = first[many], first[many] + count[many]
    for _ in range(int(count.max(initial=1) - 1).bit_length()):
        middle = (at + end) >> 1
        right = starts[np.minimum(middle, len(starts) - 1)] <= s
        # A span of one row halves to itself: it can only stay.
        right &= middle > at
        at = np.where(right, middle, at)
        end = np.where(right | (end - at <= 1), end, middle)
    low[many] = at
    return low


class CubicTable:
    """Cubic records of many owners (roads or lanes)."""

    def __init__(self, owners: Sequence[Sequence[Cubic]]) -> None:
        """Concatenates the records; each owner's records ascend in s."""
        counts = np.array([len(records) for records in owners], dtype=np.int64)
        self.count: Index = counts
        self.first: Index = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64)
        flat = [(r.s_m, r.a, r.b, r.c, r.d) for records in owners for r in records]
        rows = np.array(flat, dtype=np.float64).reshape(-1, 5)
        self.start_m: Array = np.ascontiguousarray(rows[:, 0])
        self.coefficients: Array = np.ascontiguousarray(rows[:, 1:].T)
        self.constant_zero = not rows[:, 1:].any()

    def evaluate(self, owner: Index, s_m: Array) -> tuple[Array, Array, Array]:
        """Value, first and second derivative by s, each (M,); 0 for owners without records.

        Before an owner's first record its start value holds.
        """
        zero = np.zeros(len(owner))
        if self.constant_zero:
            return zero, zero, zero
        count = self.count[owner]
        row = last_at_or_before(self.first[owner], np.maximum(count, 1), self.start_m, s_m)
        row = np.minimum(row, len(self.start_m) - 1)
        before = s_m < self.start_m[row]
        ds = np.where(before, 0.0, s_m - self.start_m[row])
        a, b, c, d = (k[row] for k in self.coefficients)
        value = a + ds * (b + ds * (c + ds * d))
        slope = np.where(before, 0.0, b + ds * (2.0 * c + ds * 3.0 * d))
        bend = np.where(before, 0.0, 2.0 * c + 6.0 * d * ds)
        has = count > 0
        return np.where(has, value, zero), np.where(has, slope, zero), np.where(has, bend, zero)
