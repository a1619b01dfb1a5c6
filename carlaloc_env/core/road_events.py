"""What lies in a road's surface and is felt: covers, repairs, and joints across lanes and at bridges."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from carlaloc_env.core.array_types import Array

EVENT_COLUMNS = ("x_m", "y_m", "cos", "sin", "half_length_m", "half_width_m", "height_m")
"""Columns of a table of events: middle, unit vector along, half the size along and across, height."""
_CELL_M = 4.0


class RoadEvents:
    """Rectangles that lie higher or lower than the road round them.

    Args:
        rows: One event each with `EVENT_COLUMNS`, world frame [m], shape (N, 7).
        footprint_m: Length and width over which a tyre averages heights [m].
    """

    def __init__(self, rows: Array, footprint_m: float) -> None:
        self._footprint = footprint_m
        self._cells: dict[tuple[int, int], list[tuple[float, ...]]] = defaultdict(list)
        for row in rows:
            x, y, cos, sin, length, width = row[:6]
            reach_x = abs(cos) * length + abs(sin) * width + footprint_m
            reach_y = abs(sin) * length + abs(cos) * width + footprint_m
            for i in range(int((x - reach_x) // _CELL_M), int((x + reach_x) // _CELL_M) + 1):
                for j in range(int((y - reach_y) // _CELL_M), int((y + reach_y) // _CELL_M) + 1):
                    self._cells[i, j].append(tuple(row.tolist()))
        self._cells.default_factory = None

    def height(self, x_m: float, y_m: float) -> float:
        """Height under a tyre at one place of the world [m]: the mean over its footprint."""
        total, foot = 0.0, self._footprint
        for x, y, cos, sin, length, width, height in self._cells.get(
            (int(x_m // _CELL_M), int(y_m // _CELL_M)), ()
        ):
            dx, dy = x_m - x, y_m - y
            along = min(length + 0.5 * foot - abs(cos * dx + sin * dy), foot, 2.0 * length)
            across = min(width + 0.5 * foot - abs(cos * dy - sin * dx), foot, 2.0 * width)
            if along > 0.0 and across > 0.0:
                total += height * along * across / (foot * foot)
        return total


def no_events() -> Array:
    """An empty table, shape (0, 7)."""
    return np.zeros((0, len(EVENT_COLUMNS)))
