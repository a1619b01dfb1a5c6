"""Which lamps make the air before a tile of the picture glow so that it shows; compiled by numba."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled, inlined

RAYS = 3
"""Rays that look for a glow along each edge of a tile, besides the one that comes nearest to the lamp."""


@compiled
def keep_glowing(
    mask: NDArray[np.bool_],
    far_m: Array,
    size_px: NDArray[np.int64],
    unproject: Array,
    rotation: Array,
    lamps: Array,
    axes: Array,
    glow: Array,
    fog: Array,
    least: float,
) -> None:
    """Clear the bits of lamps whose glow is below `least` along all of some rays of a tile.

    A glow is smooth across a tile but close to its lamp, and does not shrink with the way that one sees.

    Args:
        mask: Candidates, rows and columns of tiles by lamps, shape (R, C, N).
        far_m: Planar depth up to which the air of a tile is seen [m], shape (R, C).
        size_px: Edge of a tile, width and height of the picture [px], shape (3,).
        unproject: A ray at planar depth 1 is (x · [0] + [2], y · [1] + [3], 1).
        rotation: World axes to optical axes, shape (3, 3).
        lamps: Places from the eye [m], shape (N, 3).
        axes: Middles of the beams, shape (N, 3).
        glow: Exposed intensity / π and 1 / reach² [1/m²], shape (N, 2).
        fog: Extinction [1/m] and where the air begins [m], shape (2,).
        least: Exposed light that is not seen.
    """
    edge, width, height = size_px[0], size_px[1], size_px[2]
    for row in range(mask.shape[0]):
        top, bottom = row * edge, min((row + 1) * edge, height) - 1
        for column in range(mask.shape[1]):
            left, right = column * edge, min((column + 1) * edge, width) - 1
            for n in range(mask.shape[2]):
                if not mask[row, column, n]:
                    continue
                seen = False
                for k in range(-1, RAYS * RAYS):
                    if k < 0:
                        u, v = _nearest_px(lamps, n, unproject, rotation, left, right, top, bottom)
                    else:
                        u = left + (right - left) * (k % RAYS) / (RAYS - 1)
                        v = top + (bottom - top) * (k // RAYS) / (RAYS - 1)
                    x, y = u * unproject[0] + unproject[2], v * unproject[1] + unproject[3]
                    if _glow(x, y, far_m[row, column], rotation, lamps, axes, n, glow, fog) > least:
                        seen = True
                        break
                mask[row, column, n] = seen


@inlined
def _nearest_px(
    lamps: Array, n: int, unproject: Array, rotation: Array, left: int, right: int, top: int, bottom: int
) -> tuple[float, float]:
    """Pixel of a tile that is nearest to where a lamp is seen, or the middle for lamps behind the eye."""
    z = _along(rotation, lamps, n, 2)
    if z < 0.1:
        return 0.5 * (left + right), 0.5 * (top + bottom)
    u = (_along(rotation, lamps, n, 0) / z - unproject[2]) / unproject[0]
    v = (_along(rotation, lamps, n, 1) / z - unproject[3]) / unproject[1]
    return min(max(u, left), right), min(max(v, top), bottom)


@inlined
def _along(rotation: Array, places: Array, n: int, axis: int) -> float:
    """Coordinate of a place along an optical axis."""
    return float(
        rotation[axis, 0] * places[n, 0] + rotation[axis, 1] * places[n, 1] + rotation[axis, 2] * places[n, 2]
    )


@inlined
def _glow(
    x: float,
    y: float,
    far_m: float,
    rotation: Array,
    lamps: Array,
    axes: Array,
    n: int,
    glow: Array,
    fog: Array,
) -> float:
    """Exposed light of a lamp scattered along the ray (x, y, 1) up to a depth, as in ``lamps.glsl``."""
    length = math.sqrt(x * x + y * y + 1.0)
    dx = (rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0]) / length
    dy = (rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1]) / length
    dz = (rotation[0, 2] * x + rotation[1, 2] * y + rotation[2, 2]) / length
    end = far_m * length
    start = min(fog[1], end)
    t0 = lamps[n, 0] * dx + lamps[n, 1] * dy + lamps[n, 2] * dz
    h2 = max(lamps[n, 0] ** 2 + lamps[n, 1] ** 2 + lamps[n, 2] ** 2 - t0 * t0, 0.0)
    fade = 1.0 - h2 * glow[n, 1]
    if fade <= 0.0:
        return 0.0
    h = math.sqrt(h2 + 0.09)
    angle = math.atan2(end - t0, h) - math.atan2(start - t0, h)
    t = min(max(t0, start), end)
    nx, ny, nz = dx * t - lamps[n, 0], dy * t - lamps[n, 1], dz * t - lamps[n, 2]
    r = max(math.sqrt(nx * nx + ny * ny + nz * nz), 0.05)
    share = ((nx * axes[n, 0] + ny * axes[n, 1] + nz * axes[n, 2]) / r + 0.1) * 1.8181818
    share = min(max(share, 0.0), 1.0)
    beam = 0.15 + 1.6 * share * share * (3.0 - 2.0 * share)
    reached = math.exp(-fog[0] * (t - start + r))
    result: float = 0.25 * fog[0] * glow[n, 0] * fade * fade * beam * angle / h * reached
    return result
