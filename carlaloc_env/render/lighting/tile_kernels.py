"""What the tiles of a picture show: depths, level ground, shadows of what moves; compiled by numba."""

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
def level_tiles(
    out: NDArray[np.bool_],
    depth_m: NDArray[np.float32],
    normal_codes: NDArray[np.uint16],
    tile_px: int,
    margin_px: int,
    least_up: float,
) -> None:
    """Whether tiles, or what is near them, show something whose normal points up; looks at every other pixel.

    Args:
        out: Shape (R, C).
        depth_m: Planar depth, 0 = sky, shape (H, W).
        normal_codes: Octahedral world normals, shape (H, W, 2).
        tile_px: Edge of a tile [px].
        margin_px: How far beside it, too [px].
        least_up: Least upward part of the unit normal.
    """
    height, width = depth_m.shape
    for row in range(out.shape[0]):
        for column in range(out.shape[1]):
            out[row, column] = False
            for v in range(max(row * tile_px - margin_px, 0), min((row + 1) * tile_px + margin_px, height)):
                first = max(column * tile_px - margin_px, 0) + v % 2
                for u in range(first, min((column + 1) * tile_px + margin_px, width), 2):
                    if depth_m[v, u] == 0.0:
                        continue
                    x = normal_codes[v, u, 0] * (2.0 / 65535.0) - 1.0
                    y = normal_codes[v, u, 1] * (2.0 / 65535.0) - 1.0
                    z = 1.0 - abs(x) - abs(y)
                    if z > 0.0 and z * z >= least_up * least_up * (x * x + y * y + z * z):
                        out[row, column] = True
                        break
                if out[row, column]:
                    break


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


@compiled
def shaded_by(out: NDArray[np.bool_], low: Array, high: Array, middles: Array, radii: Array) -> None:
    """Whether boxes reach into the shadows of spheres, along the light's right, up and away.

    Args:
        out: Shape (R, C).
        low: Least coordinates of the boxes, shape (R, C, 3).
        high: Largest ones, shape (R, C, 3).
        middles: Of the spheres, shape (N, 3).
        radii: Shape (N,).
    """
    for row in range(out.shape[0]):
        for column in range(out.shape[1]):
            out[row, column] = False
            for n in range(len(middles)):
                aside = 0.0
                for axis in range(2):
                    middle = middles[n, axis]
                    gap = max(low[row, column, axis] - middle, middle - high[row, column, axis], 0.0)
                    aside += gap * gap
                if aside <= radii[n] * radii[n] and high[row, column, 2] >= middles[n, 2] - radii[n]:
                    out[row, column] = True
                    break
