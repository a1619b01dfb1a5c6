"""Logarithm of the light that falls on event pixels, the same bits on every processor."""

from __future__ import annotations

from typing import Any

import numpy as np

from carlaloc_env.core.array_types import F32
from carlaloc_env.core.cores import over_bands
from carlaloc_env.core.jit import compiled

BLUR_SIDE = 0.1065
"""Weight of each neighbour in a blur of 0.5 px (standard deviation) over three pixels, no unit."""


def log_intensity(radiance_cd_m2: F32, dark_cd_m2: float, *, blurred: bool) -> F32:
    """Log of luminance plus dark current, in cd/m², shape (H, W).

    Args:
        radiance_cd_m2: Linear BT.709 colour [cd/m²], shape (H, W, 3).
        dark_cd_m2: Luminance whose photocurrent equals the dark current [cd/m²].
        blurred: Whether the lens' blur of 0.5 px is still missing from the picture.
    """
    shape = radiance_cd_m2.shape[:2]
    luminance, out = np.empty(shape, np.float32), np.empty(shape, np.float32)
    dark, side = np.float32(dark_cd_m2), np.float32(BLUR_SIDE if blurred else 0.0)
    over_bands(lambda first, end: _luminance(radiance_cd_m2, luminance, first, end), shape[0])

    def band(first: int, end: int) -> None:
        _blur(luminance, dark, side, out, first, end)
        _take_log(out.view(np.int32), out, first, end)

    over_bands(band, shape[0])
    return out


@compiled
def _luminance(rgb: Any, out: Any, first: int, end: int) -> None:
    r, g, b = np.float32(0.2126), np.float32(0.7152), np.float32(0.0722)
    for y in range(first, end):
        for x in range(rgb.shape[1]):
            out[y, x] = r * rgb[y, x, 0] + g * rgb[y, x, 1] + b * rgb[y, x, 2]


@compiled
def _blur(image: Any, dark: Any, side: Any, out: Any, first: int, end: int) -> None:
    """Blur across and down, and add the dark current."""
    height, width = image.shape
    middle = np.float32(1) - np.float32(2) * side
    for y in range(first, end):
        up, down = max(y - 1, 0), min(y + 1, height - 1)
        for x in range(width):
            left, right = max(x - 1, 0), min(x + 1, width - 1)
            a = side * (image[up, left] + image[up, right]) + middle * image[up, x]
            b = side * (image[y, left] + image[y, right]) + middle * image[y, x]
            c = side * (image[down, left] + image[down, right]) + middle * image[down, x]
            out[y, x] = side * (a + c) + middle * b + dark


@compiled
def _take_log(bits: Any, out: Any, first: int, end: int) -> None:
    for y in range(first, end):
        for x in range(out.shape[1]):
            out[y, x] = log_of(bits[y, x])


@compiled
def log_of(bits: Any) -> Any:
    """Natural logarithm by + − × ÷ alone, the same bits on every CPU; error below 1e-7.

    ln(m·2^e) = e·ln 2 + 2·atanh((m − 1)/(m + 1)) for m from √½ to √2.

    Args:
        bits: The 32 bits of a normal, positive float32, as an integer.
    """
    m = 1.0 + np.float64(np.int32(bits & np.int32(0x7FFFFF))) * 2.0**-23
    e = np.float64(np.int32(bits >> np.int32(23)) - np.int32(127))
    high = m > 1.4142135623730951
    m, e = 0.5 * m if high else m, e + 1.0 if high else e
    q = (m - 1) / (m + 1)
    w = q * q
    series = 1 + w * (1 / 3 + w * (1 / 5 + w * (1 / 7 + w * (1 / 9 + w / 11))))
    return np.float32(e * 0.6931471805599453 + 2 * q * series)
