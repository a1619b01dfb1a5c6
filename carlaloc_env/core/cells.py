"""Thins points out by cells of a grid."""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array


def first_in_cells(points_m: Array, edge_m: float) -> NDArray[np.intp]:
    """Rows of the first point (N, 3) in each cell of a grid, increasing; the grid repeats after 2²¹ cells."""
    cell = np.floor(points_m / edge_m).astype(np.int64) & 0x1FFFFF
    _, first = np.unique(cell[:, 0] << 42 | cell[:, 1] << 21 | cell[:, 2], return_index=True)
    return np.sort(first)
