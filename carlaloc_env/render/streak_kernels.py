"""Streaks of rain on the pixels of a picture, compiled by numba."""

import math

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled, inlined
from carlaloc_env.render.drop_kernels import mixed

THINNEST_PX = 0.8
"""Streaks are never drawn thinner, but paler instead, so that they do not twinkle [px]."""
_NEAREST_M = 0.2
"""Depth at which streaks that come nearer are drawn [m]."""


@compiled
def noticeable(
    mask: NDArray[np.bool_],
    image: NDArray[np.uint8],
    begins: Array,
    ends: Array,
    diameters: Array,
    light: Array,
    intrinsics: Array,
    light_of_code: Array,
    unseen_of_code: Array,
) -> None:
    """Mark streaks that show before what lies behind their ends or their middle.

    Args:
        mask: Shape (N,).
        image: sRGB codes, shape (H, W, 4).
        begins: Ends of the streaks in the optical frame [m], shape (N, 3).
        ends: The others, shape (N, 3).
        diameters: [m], shape (N,).
        light: Exposed light and opacity, shape (N, 4).
        intrinsics: Focal lengths and principal point [px], shape (4,).
        light_of_code: Exposed light of every code, shape (256,).
        unseen_of_code: Largest invisible change of it, shape (256,).
    """
    for n in range(len(ends)):
        nearest = max(min(begins[n, 2], ends[n, 2]), _NEAREST_M)
        thickness = min(diameters[n] * intrinsics[0] / nearest / THINNEST_PX, 1.0)
        strongest = min(1.5 * light[n, 3] * thickness, 1.0)
        mask[n] = False
        for third in range(3):
            share = 0.5 * third
            z = max(begins[n, 2] + share * (ends[n, 2] - begins[n, 2]), _NEAREST_M)
            x = begins[n, 0] + share * (ends[n, 0] - begins[n, 0])
            y = begins[n, 1] + share * (ends[n, 1] - begins[n, 1])
            u = min(max(int(intrinsics[0] * x / z + intrinsics[2]), 0), image.shape[1] - 1)
            v = min(max(int(intrinsics[1] * y / z + intrinsics[3]), 0), image.shape[0] - 1)
            for channel in range(3):
                code = image[v, u, channel]
                if strongest * abs(light[n, channel] - light_of_code[code]) > unseen_of_code[code]:
                    mask[n] = True
                    break
            if mask[n]:
                break


@compiled
def streak_pixels(
    layer: NDArray[np.float32],
    touched: NDArray[np.int32],
    depth_m: NDArray[np.float32],
    begins: Array,
    ends: Array,
    diameters: Array,
    light: Array,
    intrinsics: Array,
    image: NDArray[np.uint8],
    light_of_code: Array,
    unseen_of_code: Array,
) -> int:
    """Draw streaks, one over the other, and write down which pixels they touch.

    Args:
        layer: Light and hidden share, zeros before, shape (H·W, 4).
        touched: Room for indices of pixels, shape (H·W,).
        depth_m: Planar depth of surfaces, 0 = sky, shape (H, W).
        begins: Ends of the streaks in the optical frame [m], shape (N, 3).
        ends: The others, shape (N, 3).
        diameters: [m], shape (N,).
        light: Light and opacity, shape (N, 4).
        intrinsics: Focal lengths and principal point [px], shape (4,).
        image: sRGB codes of what lies behind, shape (H·W, 4), or empty where there is no image.
        light_of_code: Exposed light of every code, shape (256,).
        unseen_of_code: Largest invisible change of it, shape (256,).

    Returns:
        Number of touched pixels.
    """
    count = 0
    focal, columns = intrinsics[0], depth_m.shape[1]
    for n in range(len(ends)):
        z0, z1 = max(begins[n, 2], _NEAREST_M), max(ends[n, 2], _NEAREST_M)
        u0 = focal * begins[n, 0] / z0 + intrinsics[2]
        v0 = intrinsics[1] * begins[n, 1] / z0 + intrinsics[3]
        du = focal * ends[n, 0] / z1 + intrinsics[2] - u0
        dv = intrinsics[1] * ends[n, 1] / z1 + intrinsics[3] - v0
        length2 = max(du * du + dv * dv, 1e-6)
        along_u, along_v, length = du / length2, dv / length2, math.sqrt(length2)
        most = max(diameters[n] * focal / min(z0, z1), THINNEST_PX)
        # Along rows of a steep streak, along columns of a flat one.
        steep = abs(dv) >= abs(du)
        start, run, other, slope = v0, dv, u0, du / (dv if dv != 0.0 else 1.0)
        lines, width = depth_m.shape
        if not steep:
            start, run, other, slope = u0, du, v0, dv / (du if du != 0.0 else 1.0)
            lines, width = width, lines
        reach = 0.5 * most * math.sqrt(1.0 + slope * slope)
        first = max(math.ceil(min(start, start + run) - 0.5 * most), 0)
        last = min(math.floor(max(start, start + run) + 0.5 * most), lines - 1)
        for line in range(first, last + 1):
            middle = other + (line - start) * slope
            low, high = max(math.ceil(middle - reach), 0), min(math.floor(middle + reach), width - 1)
            for place in range(low, high + 1):
                u, v = (place, line) if steep else (line, place)
                along = (u - u0) * along_u + (v - v0) * along_v
                if along < 0.0 or along > 1.0:
                    continue
                z = z0 + along * (z1 - z0)
                pixel = v * columns + u
                there = depth_m[v, u]
                if there > 0.0 and there <= z:
                    continue
                wide = diameters[n] * focal / z
                drawn = max(wide, THINNEST_PX)
                aside = 2.0 * length * ((u - u0) * along_v - (v - v0) * along_u) / drawn
                share = min(light[n, 3] * wide / drawn * 1.5 * (1.0 - aside * aside), 1.0)
                if share < 1e-6:
                    continue
                if layer[pixel, 3] == 0.0:
                    has_image = image.size > 0
                    if has_image and not _shows(image, pixel, light, n, share, light_of_code, unseen_of_code):
                        continue
                    touched[count] = pixel
                    count += 1
                _lay_over(layer, pixel, light, n, share)
    return count


@inlined
def _lay_over(layer: NDArray[np.float32], pixel: int, light: Array, n: int, share: float) -> None:
    """Mix a streak's light into a pixel."""
    keep = 1.0 - share
    for channel in range(3):
        layer[pixel, channel] = light[n, channel] * share + layer[pixel, channel] * keep
    layer[pixel, 3] = share + layer[pixel, 3] * keep


@inlined
def _shows(
    image: NDArray[np.uint8],
    pixel: int,
    light: Array,
    n: int,
    share: float,
    light_of_code: Array,
    unseen_of_code: Array,
) -> bool:
    """Whether a share of a streak's light in place of what lies behind it changes a pixel visibly."""
    for channel in range(3):
        code = image[pixel, channel]
        if share * abs(light[n, channel] - light_of_code[code]) >= unseen_of_code[code]:
            return True
    return False


@compiled
def over_light(
    image: NDArray[np.float32], layer: NDArray[np.float32], touched: NDArray[np.int32], count: int
) -> None:
    """Lay a layer over exposed light, both of shape (H·W, 4), and clear it."""
    for n in range(count):
        pixel = touched[n]
        for channel in range(3):
            image[pixel, channel] = image[pixel, channel] * (1 - layer[pixel, 3]) + layer[pixel, channel]
        for channel in range(4):
            layer[pixel, channel] = 0.0


@compiled
def over_codes(
    image: NDArray[np.uint8],
    layer: NDArray[np.float32],
    touched: NDArray[np.int32],
    count: int,
    light_of_code: Array,
    unseen_of_code: Array,
    code_of_root: Array,
    key: np.uint32,
    electrons: float,
    read_noise_e: float,
) -> None:
    """Lay a layer over a developed picture, both of shape (H·W, 4), and clear it.

    Args:
        image: sRGB codes.
        layer: Exposed light and hidden share.
        touched: Which pixels it touches.
        count: How many they are.
        light_of_code: Exposed light of every code, shape (256,).
        unseen_of_code: Largest invisible change of it, shape (256,).
        code_of_root: Values 0–1 by even steps of the root of exposed light up to 2.
        key: Of dither and noise.
        electrons: Of a pixel at value 1; 0 leaves the noise out.
        read_noise_e: Noise of reading it.
    """
    steps = (len(code_of_root) - 2) / 2.0
    read2 = read_noise_e * read_noise_e
    for n in range(count):
        pixel = touched[n]
        hidden = layer[pixel, 3]
        lot = mixed(np.uint32(key ^ np.uint32(pixel)))
        for channel in range(3):
            code = image[pixel, channel]
            behind = light_of_code[code]
            added = layer[pixel, channel] - hidden * behind
            layer[pixel, channel] = 0.0
            if abs(added) < unseen_of_code[code]:
                continue
            light = behind + added
            lot = mixed(np.uint32(lot + np.uint32(0x9E3779B9)))
            if electrons > 0.0:
                # The background already has the noise of its light, weakened with it.
                had = (1.0 - hidden) * (1.0 - hidden) * (behind * electrons + read2)
                variance = max(light * electrons + read2 - had, 0.0)
                even = ((lot >> np.uint32(8)) & np.uint32(0xFFF)) + (lot >> np.uint32(20))
                light += (even * 2.0**-12 - 1.0) * 2.4495 * math.sqrt(variance) / electrons
            root = min(math.sqrt(max(light, 0.0)), 2.0) * steps
            step = int(root)
            value = code_of_root[step] + (code_of_root[step + 1] - code_of_root[step]) * (root - step)
            image[pixel, channel] = min(max(int(value * 255.0 + (lot & np.uint32(0xFF)) / 256.0), 0), 255)
        layer[pixel, 3] = 0.0
