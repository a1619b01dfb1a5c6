"""Lamps that add to the light of a tile of the picture, sampled at its pixels; compiled by numba."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled, inlined
from carlaloc_env.render.lighting.light_sources import LAMP_LEAST_M
from carlaloc_env.render.lighting.low_beam import low_beam

STEP_U, STEP_V, SHIFT = 8, 2, 5
"""Samples of a row and rows are so many pixels apart, each row shifted [px]: no post or arm slips through."""
RETROREFLECTION = 0.45
"""Light that rough surfaces throw back to its lamp, by Oren and Nayar (1994)."""
TILT = 0.03
"""Sine by which a surface may lean towards a lamp more than its normal says."""


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
        points_m: Room for the samples of a tile, their normals and a lamp's light, shape (7, K).
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
                if beams[n]:
                    _lit_by_beam(points_m, count, n, lamps, axes, lefts, ups, light)
                else:
                    _lit_by_lamp(points_m, count, n, lamps, axes, light)
                lit = False
                for k in range(count):
                    if points_m[6, k] <= least:
                        continue
                    if not normal_codes.size or points_m[6, k] * _shown(points_m, k, lamps, n) > least:
                        lit = True
                        break
                mask[row, column, n] = lit


@inlined
def _lit_by_lamp(points_m: Array, count: int, n: int, lamps: Array, axes: Array, light: Array) -> None:
    """Write the exposed light of a lamp at all samples, 0 where they turn away, as in ``shade.frag``.

    Several at a time, since nothing branches and what the loop reads is not what it writes.
    """
    lamp_x, lamp_y, lamp_z = lamps[n, 0], lamps[n, 1], lamps[n, 2]
    axis_x, axis_y, axis_z = axes[n, 0], axes[n, 1], axes[n, 2]
    strength, most, begin = light[n, 0], light[n, 1], light[n, 2]
    per_way, per_range2 = 1.0 / (light[n, 3] - light[n, 2]), 1.0 / (light[n, 4] * light[n, 4])
    for k in range(count):
        x, y, z = points_m[0, k] - lamp_x, points_m[1, k] - lamp_y, points_m[2, k] - lamp_z
        far2 = max(x * x + y * y + z * z, LAMP_LEAST_M * LAMP_LEAST_M)
        away = max(points_m[3, k] * x + points_m[4, k] * y + points_m[5, k] * z, 0.0)
        cosine = (x * axis_x + y * axis_y + z * axis_z) / math.sqrt(far2)
        share = min(max((cosine - begin) * per_way, 0.0), 1.0)
        above = max(cosine, 0.0)
        gain = min(1.0 / (above * above * above + 1e-3), most)
        fade = max(1.0 - far2 * per_range2 * far2 * per_range2, 0.0)
        exposed_light = strength * fade * fade / far2 * gain * share * share * (3.0 - 2.0 * share)
        points_m[6, k] = exposed_light if away * away <= TILT * TILT * far2 else 0.0


@inlined
def _lit_by_beam(
    points_m: Array, count: int, n: int, lamps: Array, axes: Array, lefts: Array, ups: Array, light: Array
) -> None:
    """The same of a low beam."""
    lamp_x, lamp_y, lamp_z = lamps[n, 0], lamps[n, 1], lamps[n, 2]
    axis_x, axis_y, axis_z = axes[n, 0], axes[n, 1], axes[n, 2]
    left_x, left_y, left_z = lefts[n, 0], lefts[n, 1], lefts[n, 2]
    up_x, up_y, up_z = ups[n, 0], ups[n, 1], ups[n, 2]
    strength, per_range2 = light[n, 0], 1.0 / (light[n, 4] * light[n, 4])
    for k in range(count):
        x, y, z = points_m[0, k] - lamp_x, points_m[1, k] - lamp_y, points_m[2, k] - lamp_z
        far2 = max(x * x + y * y + z * z, LAMP_LEAST_M * LAMP_LEAST_M)
        away = max(points_m[3, k] * x + points_m[4, k] * y + points_m[5, k] * z, 0.0)
        fade = max(1.0 - far2 * per_range2 * far2 * per_range2, 0.0)
        beam = low_beam(
            x * axis_x + y * axis_y + z * axis_z,
            x * left_x + y * left_y + z * left_z,
            x * up_x + y * up_y + z * up_z,
        )
        exposed_light = strength * fade * fade / far2 * beam
        points_m[6, k] = exposed_light if away * away <= TILT * TILT * far2 else 0.0


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
                out[axis, count] = rotation[0, axis] * a + rotation[1, axis] * b + rotation[2, axis] * z
                out[3 + axis, count] = 0.0
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
    length = math.sqrt(x * x + y * y + z * z)
    out[3, row], out[4, row], out[5, row] = x / length, y / length, z / length


@inlined
def _shown(points_m: Array, k: int, lamps: Array, n: int) -> float:
    """Twice the share that a sample shows at most of a lamp's light, as in ``shade.frag``.

    By albedo 0.5, light thrown back by rough surfaces, and the microfacet lobe at whatever roughness
    makes it brightest there.
    """
    x, y, z = points_m[0, k] - lamps[n, 0], points_m[1, k] - lamps[n, 1], points_m[2, k] - lamps[n, 2]
    far = math.sqrt(x * x + y * y + z * z)
    away = math.sqrt(points_m[0, k] ** 2 + points_m[1, k] ** 2 + points_m[2, k] ** 2)
    nl = nv = 0.0
    for axis in range(3):
        nl -= points_m[3 + axis, k] * (x if axis == 0 else y if axis == 1 else z)
        nv -= points_m[3 + axis, k] * points_m[axis, k]
    nl, nv = nl / max(far, 1e-6), max(nv / away, 0.0)
    # Grains tilt the surface of a wet road by some degrees.
    nl += TILT
    if nl <= 0.0:
        return 0.0
    lv = (x * points_m[0, k] + y * points_m[1, k] + z * points_m[2, k]) / (max(far, 1e-6) * away)
    s = max(2.0 + 2.0 * lv, 0.01)
    nh2 = min((nl + nv) ** 2 / s, 1.0)
    lh2 = 0.25 * s
    # Between the samples the light may meet the lobe more closely.
    tangent = max(math.sqrt(1.0 / nh2 - 1.0) - TILT, 0.01)
    alpha2 = min(tangent * tangent, 0.66)
    d = (alpha2 - 1.0) / (1.0 + tangent * tangent) + 1.0
    fresnel = 0.04 + 0.96 * max(1.0 - math.sqrt(lh2), 0.0) ** 5
    gloss = alpha2 / (d * d) * fresnel / (4.0 * lh2 * (0.5 + math.sqrt(alpha2)))
    back = RETROREFLECTION * max(lv - nl * nv, 0.0) / max(nl, nv, 0.01)
    result: float = nl * (1.0 + back + 2.0 * min(gloss, 40.0))
    return result
