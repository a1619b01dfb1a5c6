"""Loops over drops, compiled by numba."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.compiled import compiled

Array = NDArray[np.float64]

THINNEST_PX = 0.8
"""Streaks are never drawn thinner, but paler instead, so that they do not twinkle [px]."""
_NEAREST_M = 0.2
UNSEEN_STEP, UNSEEN_NOISE = 0.25, 0.2
"""Changes that nobody sees, in steps of 8 bits and in standard deviations of the noise."""


@compiled
def _mixed(x: np.uint32) -> np.uint32:
    x = np.uint32(x ^ (x >> np.uint32(16)))
    x = np.uint32(x * np.uint32(0x7FEB352D))
    x = np.uint32(x ^ (x >> np.uint32(15)))
    x = np.uint32(x * np.uint32(0x846CA68B))
    return np.uint32(x ^ (x >> np.uint32(16)))


@compiled
def fill(
    out: Array,
    cells: NDArray[np.int64],
    most: int,
    share: np.uint32,
    key: np.uint32,
    home: Array,
    normals: Array,
    offsets: Array,
) -> int:
    """Write the drops of some cells that lie inside all planes to `out` and count them.

    Args:
        out: Places from the eye in units of cells of 1 m, shape (len(cells) · most, 3).
        cells: Shape (C, 3).
        most: Drops that a cell may have.
        share: Share of them that it has, of 2**32.
        key: Chooses the pattern.
        home: Eye in the lattice's frame [m], shape (3,).
        normals: Inward normals of planes, shape (P, 3).
        offsets: Their offsets from the eye [m], shape (P,).
    """
    count = 0
    for c in range(len(cells)):
        h = key
        for axis in range(3):
            h = _mixed(np.uint32(h ^ np.uint32(cells[c, axis] & 0xFFFFFFFF)))
        for k in range(most):
            lot = _mixed(np.uint32(h + np.uint32(k) * np.uint32(0x9E3779B9)))
            if lot >= share:
                continue
            for axis in range(3):
                lot = _mixed(np.uint32(lot + np.uint32(0x85EBCA6B)))
                out[count, axis] = (cells[c, axis] + lot * 2.0**-32) - home[axis]
            inside = True
            for p in range(len(offsets)):
                gap = offsets[p]
                for axis in range(3):
                    gap += normals[p, axis] * out[count, axis]
                inside = inside and gap > 0.0
            if inside:
                count += 1
    return count


@compiled
def shine(
    out: Array,
    drops: Array,
    lamps: Array,
    axes: Array,
    lefts: Array,
    ups: Array,
    colours: Array,
    caps: Array,
    edges: Array,
    ranges: Array,
    beams: NDArray[np.bool_],
) -> None:
    """Add the luminance [cd/m²] that lamps give to drops; places are relative to the eye [m]."""
    for i in range(len(drops)):
        far = math.sqrt(drops[i, 0] ** 2 + drops[i, 1] ** 2 + drops[i, 2] ** 2)
        for k in range(len(lamps)):
            x, y, z = drops[i, 0] - lamps[k, 0], drops[i, 1] - lamps[k, 1], drops[i, 2] - lamps[k, 2]
            r2 = max(x * x + y * y + z * z, 0.25)
            ratio = r2 / (ranges[k] * ranges[k])
            if ratio >= 1.0:
                continue
            r = math.sqrt(r2)
            x, y, z = x / r, y / r, z / r
            turn = -(x * drops[i, 0] + y * drops[i, 1] + z * drops[i, 2]) / far
            spread = 1.0 + 0.85**2 - 1.7 * turn
            phase = (0.75 * (1.0 - 0.85**2) / (spread * math.sqrt(spread)) + 0.25) / (4.0 * math.pi)
            fade = (1.0 - ratio * ratio) ** 2
            ahead = x * axes[k, 0] + y * axes[k, 1] + z * axes[k, 2]
            if beams[k]:
                left = x * lefts[k, 0] + y * lefts[k, 1] + z * lefts[k, 2]
                gain = low_beam(ahead, left, x * ups[k, 0] + y * ups[k, 1] + z * ups[k, 2])
            else:
                share = min(max((ahead - edges[k, 0]) / (edges[k, 1] - edges[k, 0]), 0.0), 1.0)
                gain = min(1.0 / (max(ahead, 0.0) ** 3 + 1e-3), caps[k]) * share * share * (3 - 2 * share)
            for channel in range(3):
                out[i, channel] += gain * phase * fade / r2 * colours[k, channel]


@compiled
def low_beam(ahead: float, left: float, up: float) -> float:
    """Intensity of a low beam [cd], as in ``shade.frag``; components of a direction from the lamp."""
    if ahead <= 0.05:
        return 0.0
    h, v = -57.29578 * left / ahead, 57.29578 * up / ahead
    cut = min(-0.57 + max(h, 0.0) * 0.268, 1.0)
    below = 1.0 / (1.0 + math.exp(min(9.0 * (v - cut), 60.0)))
    narrow = 26000.0 * math.exp(-0.5 * (((h - 1.5) / 2.3) ** 2 + ((v + 1.0) / 0.9) ** 2))
    wide = 8000.0 * math.exp(-0.5 * ((h / 9.0) ** 2 + ((v + 1.8) / 1.8) ** 2))
    floor = 4200.0 * math.exp(-0.5 * ((h / 20.0) ** 2 + ((v + 4.5) / 3.5) ** 2))
    halo = 180.0 * math.exp(-0.5 * ((h / 25.0) ** 2 + (v / 12.0) ** 2))
    result: float = below * (narrow + wide + floor) + halo
    return result


@compiled
def noticeable(
    mask: NDArray[np.bool_],
    picture: NDArray[np.uint8],
    begins: Array,
    ends: Array,
    diameters: Array,
    light: Array,
    intrinsics: Array,
    light_of_code: Array,
    electrons: float,
    read_noise_e: float,
) -> None:
    """Mark streaks that show before what lies behind their ends or their middle.

    Args:
        mask: Shape (N,).
        picture: sRGB codes, shape (H, W, 4).
        begins: Ends of the streaks in the optical frame [m], shape (N, 3).
        ends: The others, shape (N, 3).
        diameters: [m], shape (N,).
        light: Exposed light and opacity, shape (N, 4).
        intrinsics: Focal lengths and principal point [px], shape (4,).
        light_of_code: Exposed light of every code, shape (256,).
        electrons: Of a pixel at value 1; 0 without noise.
        read_noise_e: Noise of reading it.
    """
    for n in range(len(ends)):
        nearest = max(min(begins[n, 2], ends[n, 2]), _NEAREST_M)
        strongest = min(
            1.5 * light[n, 3] * min(diameters[n] * intrinsics[0] / nearest / THINNEST_PX, 1.0), 1.0
        )
        mask[n] = False
        for third in range(3):
            share = 0.5 * third
            z = max(begins[n, 2] + share * (ends[n, 2] - begins[n, 2]), _NEAREST_M)
            x = begins[n, 0] + share * (ends[n, 0] - begins[n, 0])
            y = begins[n, 1] + share * (ends[n, 1] - begins[n, 1])
            u = min(max(int(intrinsics[0] * x / z + intrinsics[2]), 0), picture.shape[1] - 1)
            v = min(max(int(intrinsics[1] * y / z + intrinsics[3]), 0), picture.shape[0] - 1)
            for channel in range(3):
                code = picture[v, u, channel]
                behind = light_of_code[code]
                least = UNSEEN_STEP * (light_of_code[min(code + 1, 255)] - behind)
                if electrons > 0.0:
                    noise = math.sqrt(behind * electrons + read_noise_e * read_noise_e) / electrons
                    least = max(least, UNSEEN_NOISE * noise)
                if strongest * abs(light[n, channel] - behind) > least:
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
                keep = 1.0 - share
                if layer[pixel, 3] == 0.0:
                    touched[count] = pixel
                    count += 1
                for channel in range(3):
                    layer[pixel, channel] = light[n, channel] * share + layer[pixel, channel] * keep
                layer[pixel, 3] = share + layer[pixel, 3] * keep
    return count


@compiled
def over_light(
    picture: NDArray[np.float32], layer: NDArray[np.float32], touched: NDArray[np.int32], count: int
) -> None:
    """Lay a layer over exposed light, both of shape (H·W, 4), and clear it."""
    for n in range(count):
        pixel = touched[n]
        for channel in range(3):
            picture[pixel, channel] = picture[pixel, channel] * (1 - layer[pixel, 3]) + layer[pixel, channel]
        for channel in range(4):
            layer[pixel, channel] = 0.0


@compiled
def over_codes(
    picture: NDArray[np.uint8],
    layer: NDArray[np.float32],
    touched: NDArray[np.int32],
    count: int,
    light_of_code: Array,
    code_of_root: Array,
    key: np.uint32,
    electrons: float,
    read_noise_e: float,
) -> None:
    """Lay a layer over a developed picture, both of shape (H·W, 4), and clear it.

    Args:
        picture: sRGB codes.
        layer: Exposed light and hidden share.
        touched: Which pixels it touches.
        count: How many they are.
        light_of_code: Exposed light of every code, shape (256,).
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
        lot = _mixed(np.uint32(key ^ np.uint32(pixel)))
        for channel in range(3):
            code = picture[pixel, channel]
            behind, more = light_of_code[code], light_of_code[min(code + 1, 255)]
            added = layer[pixel, channel] - hidden * behind
            layer[pixel, channel] = 0.0
            if abs(added) < UNSEEN_STEP * (more - behind):
                continue
            light = behind + added
            lot = _mixed(np.uint32(lot + np.uint32(0x9E3779B9)))
            if electrons > 0.0:
                # What lies behind has the noise of its own light already, weakened with it.
                had = (1.0 - hidden) * (1.0 - hidden) * (behind * electrons + read2)
                variance = max(light * electrons + read2 - had, 0.0)
                even = ((lot >> np.uint32(8)) & np.uint32(0xFFF)) + (lot >> np.uint32(20))
                light += (even * 2.0**-12 - 1.0) * 2.4495 * math.sqrt(variance) / electrons
            root = min(math.sqrt(max(light, 0.0)), 2.0) * steps
            step = int(root)
            value = code_of_root[step] + (code_of_root[step + 1] - code_of_root[step]) * (root - step)
            picture[pixel, channel] = min(max(int(value * 255.0 + (lot & np.uint32(0xFF)) / 256.0), 0), 255)
        layer[pixel, 3] = 0.0
