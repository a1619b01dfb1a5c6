"""Drops and flakes on the lens: an option, off in the paper's rig with its wiped pane."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import clock
from carlaloc_env.weather.parameters import WeatherParameters

MOST = 90
"""Drops on the lens in rain of 50 mm/h."""
FLAKES_PER_MMPH = 12
"""Flakes on the lens per mm/h of snow, as water; they melt within `LIFE_NS`."""
LIFE_NS = 3_000_000_000
"""How long a drop stays before another takes its place [ns]."""


def with_lens_drops(
    rgb: NDArray[np.uint8], weather: WeatherParameters, *, stamp_ns: int, seed: int, camera: str
) -> NDArray[np.uint8]:
    """The picture as seen through drops that cling to the lens and slide down.

    A drop is a small lens: it shows the scene upside down and smaller. A flake is a white pane: it shows the
    mean of the picture's upper half, and melts into a drop that stays where it is. Where they are follows
    from seed, camera and time alone, so both eyes differ and any picture can be made alone.

    Args:
        rgb: Picture, sRGB, shape (H, W, 3).
        weather: How much it rains or snows.
        stamp_ns: Time of the picture [ns].
        seed: Seed of the drops.
        camera: Name of the camera.
    """
    height, width = rgb.shape[:2]
    flakes = weather.snowfall > 0.0
    count = math.ceil(FLAKES_PER_MMPH * weather.snowfall if flakes else MOST * weather.precipitation / 100.0)
    v, u = np.mgrid[:height, :width].astype(np.float32)
    blur = np.zeros((height, width), np.float32)
    white = np.zeros((height, width), np.float32)
    for k in range(count):
        age_ns = stamp_ns + k * LIFE_NS // max(count, 1)
        draw = clock.stream(seed, f"{camera}/lens/{k}", age_ns // LIFE_NS)
        x, y, size, speed = draw.random(4)
        age_s = age_ns % LIFE_NS * 1e-9
        radius = (3.0 + 11.0 * size**2) * width / 1280.0
        slides = 0.0 if flakes else (5.0 + 35.0 * speed) * age_s * size * width / 1280.0
        cx, cy = x * width, y * height + slides
        low_u, high_u = max(int(cx - radius), 0), min(int(cx + radius) + 2, width)
        low_v, high_v = max(int(cy - radius), 0), min(int(cy + radius) + 2, height)
        box = np.s_[low_v:high_v, low_u:high_u]
        if not blur[box].size:
            continue
        dv, du = np.mgrid[low_v:high_v, low_u:high_u].astype(np.float32)
        du, dv = du - np.float32(cx), dv - np.float32(cy)
        r2 = (du * du + dv * dv) / np.float32(radius * radius)
        inside = r2 < 1.0
        # Upside down, and the more so towards the rim (Lagarde's lens: 1.6 times the offset and more).
        bend = np.float32(-6.0) * (1 + 2 * r2)
        u[box] = np.where(inside, np.float32(cx) + bend * du, u[box])
        v[box] = np.where(inside, np.float32(cy) + bend * dv, v[box])
        blur[box] = np.where(inside, np.maximum(blur[box], np.minimum(4 * (1 - r2), 1)), blur[box])
        if flakes:
            frozen = np.float32(0.8 * max(1.0 - 1e9 * age_s / LIFE_NS, 0.0))
            white[box] = np.maximum(white[box], frozen * np.clip(1 - r2, 0, 1))
    bent = cv2.remap(rgb, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    share = blur[..., None]
    seen = rgb * (1 - share) + bent * share
    if flakes:
        seen += white[..., None] * (rgb[: height // 2].mean(axis=(0, 1), dtype=np.float32) - seen)
    return np.asarray(seen + np.float32(0.5), dtype=np.uint8)
