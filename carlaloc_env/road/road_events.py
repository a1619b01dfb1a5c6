"""Events in a road's surface that wheels feel: covers, repairs, and joints across lanes and at bridges."""

from collections import defaultdict
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled

EVENT_COLUMNS = ("x_m", "y_m", "cos", "sin", "half_length_m", "half_width_m", "height_m")
"""Columns of a table of events: middle, unit vector along, half the size along and across, height."""
_CELL_M = 4.0
"""Side of the squares by which events are found [m]."""


class EventTable(NamedTuple):
    """Events by the square in which they lie, for compiled functions."""

    rows: Array
    """Events with `EVENT_COLUMNS`, those of a square one after the other, shape (M, 7)."""
    first: NDArray[np.int64]
    """First row of each square; one more ends the last, east then north, shape (I · J + 1,)."""
    shape: tuple[int, int]
    """Number of squares, I and J."""
    low: tuple[int, int]
    """Number of the first square towards east and north, counted from the world's origin."""
    footprint_m: float
    """Length and width over which a tyre averages heights [m]."""


def event_table(rows: Array, footprint_m: float) -> EventTable:
    """Table of rectangles that lie higher or lower than the road round them.

    Args:
        rows: One event each with `EVENT_COLUMNS`, world frame [m], shape (N, 7).
        footprint_m: Length and width over which a tyre averages heights [m].
    """
    cells: dict[tuple[int, int], list[Array]] = defaultdict(list)
    for row in rows:
        x, y, cos, sin, length, width = row[:6]
        reach_x = abs(cos) * length + abs(sin) * width + footprint_m
        reach_y = abs(sin) * length + abs(cos) * width + footprint_m
        for i in range(int((x - reach_x) // _CELL_M), int((x + reach_x) // _CELL_M) + 1):
            for j in range(int((y - reach_y) // _CELL_M), int((y + reach_y) // _CELL_M) + 1):
                cells[i, j].append(row)
    if not cells:
        return EventTable(no_events(), np.zeros(1, np.int64), (0, 0), (0, 0), footprint_m)
    numbers = np.array(list(cells))
    low, shape = numbers.min(axis=0), np.ptp(numbers, axis=0) + 1
    count = np.zeros(shape, np.int64)
    for cell, held in cells.items():
        count[cell[0] - low[0], cell[1] - low[1]] = len(held)
    return EventTable(
        rows=np.array([row for cell in sorted(cells) for row in cells[cell]], dtype=np.float64),
        first=np.concatenate([[0], np.cumsum(count.ravel())]),
        shape=(int(shape[0]), int(shape[1])),
        low=(int(low[0]), int(low[1])),
        footprint_m=footprint_m,
    )


@compiled
def event_height(table: EventTable, x_m: float, y_m: float) -> float:
    """Height under a tyre at one place of the world [m]: the mean over its footprint."""
    i = int(np.floor(x_m / _CELL_M)) - table.low[0]
    j = int(np.floor(y_m / _CELL_M)) - table.low[1]
    if i < 0 or j < 0 or i >= table.shape[0] or j >= table.shape[1]:
        return 0.0
    total, foot = 0.0, table.footprint_m
    cell = i * table.shape[1] + j
    for n in range(table.first[cell], table.first[cell + 1]):
        x, y, cos, sin = table.rows[n, 0], table.rows[n, 1], table.rows[n, 2], table.rows[n, 3]
        length, width, height = table.rows[n, 4], table.rows[n, 5], table.rows[n, 6]
        dx, dy = x_m - x, y_m - y
        along = min(length + 0.5 * foot - abs(cos * dx + sin * dy), foot, 2.0 * length)
        across = min(width + 0.5 * foot - abs(cos * dy - sin * dx), foot, 2.0 * width)
        if along > 0.0 and across > 0.0:
            total += height * along * across / (foot * foot)
    return total


def no_events() -> Array:
    """An empty table, shape (0, 7)."""
    return np.zeros((0, len(EVENT_COLUMNS)))
