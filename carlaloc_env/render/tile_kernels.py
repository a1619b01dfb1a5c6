"""Which lamps add to what a tile of the picture shows, sampled at its pixels; compiled by numba."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.compiled import compiled
from carlaloc_env.render.rain_kernels import low_beam

Array = NDArray[np.float64]

STEP_U, STEP_V, SHIFT = 8, 2, 5
"""Samples of a row and rows are so many pixels apart, each row shifted [px]: no post or arm slips through."""


@compiled
def keep_lit(
    mask: NDArray[np.bool_],
    points_m: Array,
    tile_px: int,
    depth_m: NDArray[np.float32],
    unproject: Array,
    rotation: Array,
    lamps: Array,
    axes: Array,
    lefts: Array,
    ups: Array,
    light: Array,
    beams: NDArray[np.bool_],
    least: float,
) -> None:
    """Clear the bits of lamps that give none of a tile's sampled surfaces as much as `least`.

    Which way the surfaces face is left open.

    Args:
        mask: Candidates, rows and columns of tiles by lamps, shape (R, C, N).
        points_m: Room for the samples of a tile, shape (K, 3).
        tile_px: Edge of a tile [px].
        depth_m: Planar depth, 0 = sky, shape (H, W).
        unproject: A ray at planar depth 1 is (x · [0] + [2], y · [1] + [3], 1).
        rotation: World axes to optical axes, shape (3, 3).
        lamps: Places from the eye [m], shape (N, 3).
        axes: Middles of the beams, shape (N, 3).
        lefts: Left of headlamps, shape (N, 3).
        ups: Above headlamps, shape (N, 3).
        light: Exposed intensity, most gain, cosines of the edge, range [m], shape (N, 5).
        beams: Whether it is a low beam, shape (N,).
        least: Exposed light that is not seen.
    """
    for row in range(mask.shape[0]):
        for column in range(mask.shape[1]):
            count = _sample(points_m, row * tile_px, column * tile_px, tile_px, depth_m, unproject, rotation)
            for n in range(mask.shape[2]):
                if not mask[row, column, n]:
                    continue
                lit = False
                for k in range(count):
                    x, y = points_m[k, 0] - lamps[n, 0], points_m[k, 1] - lamps[n, 1]
                    if _light(x, y, points_m[k, 2] - lamps[n, 2], n, axes, lefts, ups, light, beams) > least:
                        lit = True
                        break
                mask[row, column, n] = lit


@compiled
def _sample(
    out: Array,
    top: int,
    left: int,
    tile_px: int,
    depth_m: NDArray[np.float32],
    unproject: Array,
    rotation: Array,
) -> int:
    """Write the sampled surface points of a tile [m from the eye, world axes] and count them."""
    count = 0
    for v in range(top, min(top + tile_px, depth_m.shape[0]), STEP_V):
        first = left + (v // STEP_V * SHIFT) % STEP_U
        for u in range(first, min(left + tile_px, depth_m.shape[1]), STEP_U):
            z = np.float64(depth_m[v, u])
            if z == 0.0:
                continue
            a, b = (u * unproject[0] + unproject[2]) * z, (v * unproject[1] + unproject[3]) * z
            for axis in range(3):
                out[count, axis] = rotation[0, axis] * a + rotation[1, axis] * b + rotation[2, axis] * z
            count += 1
    return count


@compiled
def _light(
    x: float,
    y: float,
    z: float,
    n: int,
    axes: Array,
    lefts: Array,
    ups: Array,
    light: Array,
    beams: NDArray[np.bool_],
) -> float:
    """Exposed light of a lamp at a way from it [m], as in ``shade.frag``."""
    near2 = max(x * x + y * y + z * z, 0.25)
    ratio = near2 / (light[n, 4] * light[n, 4])
    if ratio >= 1.0:
        return 0.0
    ahead = x * axes[n, 0] + y * axes[n, 1] + z * axes[n, 2]
    full = light[n, 0] * (1.0 - ratio * ratio) ** 2 / near2
    if beams[n]:
        left = x * lefts[n, 0] + y * lefts[n, 1] + z * lefts[n, 2]
        up = x * ups[n, 0] + y * ups[n, 1] + z * ups[n, 2]
        result: float = full * low_beam(ahead, left, up)
        return result
    cosine = ahead / near2**0.5
    if cosine <= light[n, 2]:
        return 0.0
    share = min((cosine - light[n, 2]) / (light[n, 3] - light[n, 2]), 1.0)
    gain = min(1.0 / (max(cosine, 0.0) ** 3 + 1e-3), light[n, 1])
    result = full * gain * share * share * (3.0 - 2.0 * share)
    return result
