"""Which lamps add to what a tile of the picture shows, sampled at its pixels; compiled by numba."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.compiled import compiled
from carlaloc_env.render.rain_kernels import low_beam

Array = NDArray[np.float64]

STEP_U, STEP_V, SHIFT = 8, 2, 5
"""Samples of a row and rows are so many pixels apart, each row shifted [px]: no post or arm slips through."""
TILT = 0.03
"""Sine by which a surface may lean towards a lamp more than its normal says."""


@compiled
def depth_ranges(near_m: Array, far_m: Array, depth_m: NDArray[np.float32], tile_px: int) -> None:
    """Write the nearest and farthest surface of every tile [m]; inf and 0 where there is sky only.

    Args:
        near_m: Shape (R, C).
        far_m: Shape (R, C).
        depth_m: Planar depth, 0 = sky, shape (H, W).
        tile_px: Edge of a tile [px].
    """
    near_m[:] = np.inf
    far_m[:] = 0.0
    columns = depth_m.shape[1]
    for v in range(depth_m.shape[0]):
        row = v // tile_px
        for column in range(near_m.shape[1]):
            near, far = np.float32(np.inf), np.float32(0.0)
            for u in range(column * tile_px, min(column * tile_px + tile_px, columns)):
                depth = depth_m[v, u]
                far = max(far, depth)
                near = min(near, depth if depth > 0.0 else np.float32(np.inf))
            near_m[row, column] = min(near_m[row, column], near)
            far_m[row, column] = max(far_m[row, column], far)


@compiled
def keep_lit(
    mask: NDArray[np.bool_],
    points_m: Array,
    tile_px: int,
    depth_m: NDArray[np.float32],
    normal_codes: NDArray[np.uint16],
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

    Without normals, which way the surfaces face is left open.

    Args:
        mask: Candidates, rows and columns of tiles by lamps, shape (R, C, N).
        points_m: Room for the samples of a tile and their normals, shape (K, 6).
        tile_px: Edge of a tile [px].
        depth_m: Planar depth, 0 = sky, shape (H, W).
        normal_codes: Octahedral world normals, shape (H, W, 2), or none of them.
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
            top, left = row * tile_px, column * tile_px
            count = _sample(points_m, top, left, tile_px, depth_m, normal_codes, unproject, rotation)
            for n in range(mask.shape[2]):
                if not mask[row, column, n]:
                    continue
                lit = False
                for k in range(count):
                    x, y = points_m[k, 0] - lamps[n, 0], points_m[k, 1] - lamps[n, 1]
                    z = points_m[k, 2] - lamps[n, 2]
                    if normal_codes.size:
                        away = points_m[k, 3] * x + points_m[k, 4] * y + points_m[k, 5] * z
                        if away > 0.0 and away * away > TILT * TILT * (x * x + y * y + z * z):
                            continue
                    light_k = _light(x, y, z, n, axes, lefts, ups, light, beams)
                    if light_k > least and normal_codes.size:
                        light_k *= _shown(points_m, k, x, y, z)
                    if light_k > least:
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
    normal_codes: NDArray[np.uint16],
    unproject: Array,
    rotation: Array,
) -> int:
    """Write the sampled surface points of a tile [m from the eye, world axes], their normals; count them."""
    count = 0
    bottom = min(top + tile_px, depth_m.shape[0])
    # The last row, too: near the horizon the next one is many metres nearer.
    for row in range(top, bottom + STEP_V - 1, STEP_V):
        v = min(row, bottom - 1)
        first = left + (v // STEP_V * SHIFT) % STEP_U
        for u in range(first, min(left + tile_px, depth_m.shape[1]), STEP_U):
            z = np.float64(depth_m[v, u])
            if z == 0.0:
                continue
            a, b = (u * unproject[0] + unproject[2]) * z, (v * unproject[1] + unproject[3]) * z
            for axis in range(3):
                out[count, axis] = rotation[0, axis] * a + rotation[1, axis] * b + rotation[2, axis] * z
            if normal_codes.size:
                _decode(out, count, normal_codes[v, u, 0], normal_codes[v, u, 1])
            count += 1
    return count


@compiled
def _decode(out: Array, row: int, code_x: int, code_y: int) -> None:
    """Write the unit normal of an octahedral code."""
    x, y = code_x * (2.0 / 65535.0) - 1.0, code_y * (2.0 / 65535.0) - 1.0
    z = 1.0 - abs(x) - abs(y)
    fold = max(-z, 0.0)
    x += -fold if x >= 0.0 else fold
    y += -fold if y >= 0.0 else fold
    length = (x * x + y * y + z * z) ** 0.5
    out[row, 3], out[row, 4], out[row, 5] = x / length, y / length, z / length


@compiled
def _shown(points_m: Array, k: int, x: float, y: float, z: float) -> float:
    """Twice the share that a surface shows at most of light along (x, y, z), as in ``shade.frag``.

    By albedo 0.5, light thrown back by rough surfaces, and the microfacet lobe at whatever roughness
    makes it brightest there.
    """
    far = (x * x + y * y + z * z) ** 0.5
    away = (points_m[k, 0] ** 2 + points_m[k, 1] ** 2 + points_m[k, 2] ** 2) ** 0.5
    nl = nv = 0.0
    for axis in range(3):
        nl -= points_m[k, 3 + axis] * (x if axis == 0 else y if axis == 1 else z)
        nv -= points_m[k, 3 + axis] * points_m[k, axis]
    nl, nv = nl / max(far, 1e-6), max(nv / away, 0.0)
    # Grains tilt the surface of a wet road by some degrees.
    nl += TILT
    if nl <= 0.0:
        return 0.0
    lv = (x * points_m[k, 0] + y * points_m[k, 1] + z * points_m[k, 2]) / (max(far, 1e-6) * away)
    s = max(2.0 + 2.0 * lv, 0.01)
    nh2 = min((nl + nv) ** 2 / s, 1.0)
    lh2 = 0.25 * s
    # Between the samples the light may meet the lobe more closely.
    tangent = max((1.0 / nh2 - 1.0) ** 0.5 - TILT, 0.01)
    alpha2 = min(tangent * tangent, 0.66)
    d = (alpha2 - 1.0) / (1.0 + tangent * tangent) + 1.0
    fresnel = 0.04 + 0.96 * max(1.0 - lh2**0.5, 0.0) ** 5
    gloss = alpha2 / (d * d) * fresnel / (4.0 * lh2 * (0.5 + alpha2**0.5))
    back = 0.45 * max(lv - nl * nv, 0.0) / max(nl, nv, 0.01)
    result: float = nl * (1.0 + back + 2.0 * min(gloss, 40.0))
    return result


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
