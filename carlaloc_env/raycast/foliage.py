"""Depth of rays in foliage, by Beer and Lambert's law, as between leaves of no order.

A crown's triangles are its outside, at which pictures end. A LiDAR's beam meets a leaf somewhere behind.
"""

import math

import numpy as np

from carlaloc_env.core import elementary, elementary_kernels
from carlaloc_env.core.array_types import F32, Array
from carlaloc_env.core.jit import compiled

FREE_PATH_M = 0.4
"""Mean way to the first leaf [m]: 1/(½ · 5 m²/m³), for leaves at all angles as dense as in a hedge."""
DEEPEST_M = 3.0 * FREE_PATH_M
"""Rays that would get farther are drawn anew [m]."""
GAP_M = 0.8
"""Surfaces farther behind one another belong to different crowns [m]."""
CELL_M = 0.04
"""Rays that enter in one cell of this size get equally deep [m]."""
_PASSED = 1.0 - float(elementary.exp(np.float64(-DEEPEST_M / FREE_PATH_M)))
"""Share of the rays that get no farther than the deepest."""


@compiled
def leaf_depths(entry_m: F32, origin_m: Array, out: Array) -> None:
    """Distance behind the outside at which rays meet a leaf [m], a function of the place alone.

    Args:
        entry_m: Where rays enter [m], shape (N, 3).
        origin_m: Where the frame's origin lies in the world [m], shape (3,).
        out: Receives the depths, shape (N,).
    """
    low = np.uint64(0xFFFFFFFF)
    for k in range(len(entry_m)):
        h = np.uint64(0)
        for axis in range(3):
            cell = np.uint64(math.floor((entry_m[k, axis] + origin_m[axis]) / CELL_M))
            h = ((h ^ cell) * np.uint64(0x9E3779B1) + np.uint64(axis)) & low
            h ^= h >> np.uint64(15)
        h = (h * np.uint64(0x2C1B3C6D)) & low
        h ^= h >> np.uint64(13)
        share = (float(h >> np.uint64(8)) + 0.5) / 16777216.0
        out[k] = -FREE_PATH_M * elementary_kernels.log(1.0 - share * _PASSED)
