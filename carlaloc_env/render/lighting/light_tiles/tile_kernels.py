"""Depths of the tiles of a picture, and their lists of lights; compiled by numba."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled


@compiled
def depth_ranges(
    near_m: Array, far_m: Array, sky: NDArray[np.bool_], depth_m: NDArray[np.float32], tile_px: int
) -> None:
    """Write the nearest and farthest surface of every tile [m], inf and 0 where there is sky only.

    Args:
        near_m: Shape (R, C).
        far_m: Shape (R, C).
        sky: Whether some of the tile is sky, shape (R, C).
        depth_m: Planar depth, 0 = sky, shape (H, W).
        tile_px: Edge of a tile [px].
    """
    near_m[:] = np.inf
    far_m[:] = 0.0
    sky[:] = False
    columns = depth_m.shape[1]
    for v in range(depth_m.shape[0]):
        row = v // tile_px
        for column in range(near_m.shape[1]):
            near, far, least = np.float32(np.inf), np.float32(0.0), np.float32(np.inf)
            for u in range(column * tile_px, min(column * tile_px + tile_px, columns)):
                depth = depth_m[v, u]
                far = max(far, depth)
                least = min(least, depth)
                near = min(near, depth if depth > 0.0 else np.float32(np.inf))
            near_m[row, column] = min(near_m[row, column], near)
            far_m[row, column] = max(far_m[row, column], far)
            sky[row, column] = sky[row, column] or least <= 0.0


@compiled
def list_lights(
    entries: NDArray[np.intp], ends: NDArray[np.uint32], mask: NDArray[np.bool_], begin: int
) -> None:
    """Write the lists of all tiles, one after the other.

    Args:
        entries: Indices of lights, written from `begin` on.
        ends: Where the list of every tile begins, and the end of the last one, shape (tiles + 1,).
        mask: Which light belongs to which tile, shape (tiles, N).
        begin: First entry of the first list.
    """
    for tile in range(mask.shape[0]):
        ends[tile] = begin
        for n in range(mask.shape[1]):
            if mask[tile, n]:
                entries[begin] = n
                begin += 1
    ends[mask.shape[0]] = begin
