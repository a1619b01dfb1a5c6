"""From light on the pixels to a picture: shutter, motion blur, noise.

The imager: from light on the pixels to numbers in the picture, after EMVA 1288.

N = η·E·t electrons gather in a pixel during the exposure t, with Poisson noise; reading adds a
normal one. Gain, conversion to whole numbers and a tone curve follow.

Motion blur and rolling shutter: pixels between two drawn pictures, along the true motion.

Each row has its own times of exposure; the light of a pixel is the mean over them.
"""

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import clock
from carlaloc_env.core.array_types import F32
from carlaloc_env.core.cores import over_bands
from carlaloc_env.core.jit import compiled, inlined
from carlaloc_env.sensors.camera_config import ImagerConfig
from carlaloc_env.sensors.imaging.frame import FrameMotion
from carlaloc_env.sensors.imaging.motion_field import source_of


class Imager:
    """One imager with its fixed patterns."""

    def __init__(self, config: ImagerConfig, name: str, shape: tuple[int, int], seed: int) -> None:
        self.config = config
        self._name, self._seed = f"imager_{name}", seed
        v, u = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
        x, y = u - np.float32(shape[1] / 2), v - np.float32(shape[0] / 2)
        rr = (x * x + y * y) / np.float32((shape[1] ** 2 + shape[0] ** 2) / 4)
        light = np.float32(1) - np.float32(config.vignetting) * rr
        pixels = shape if config.bayer else (*shape, 3)
        self._response = light.copy() if config.bayer else np.repeat(light[..., None], 3, axis=2)
        self._offset_e = np.zeros(pixels, np.float32)
        if config.noise:
            generator = clock.stream(seed, f"{self._name}/pattern")
            spread = generator.standard_normal((2, *pixels), dtype=np.float32)
            self._response *= np.float32(1) + np.float32(config.response) * spread[0]
            self._offset_e = np.float32(config.dark_signal_e) * spread[1]
        top = 1 << config.adc_bits
        curve = [round(255.0 * (k / (top - 1)) ** (1.0 / config.gamma)) for k in range(top)]
        self._curve = np.array(curve, np.uint8)

    def level_cd_m2(self, radiance_cd_m2: F32) -> float:
        """Input of the exposure control: mean luminance on every eighth pixel, behind the lens [cd/m²]."""
        response = self._response.reshape(*radiance_cd_m2.shape[:2], -1)
        some = (radiance_cd_m2[::8, ::8] * response[::8, ::8]).astype(np.float64)
        return float((0.2126 * some[..., 0] + 0.7152 * some[..., 1] + 0.0722 * some[..., 2]).mean())

    def picture(self, radiance_cd_m2: F32, product_s: float, stamp_ns: int) -> NDArray[np.uint8]:
        """Picture of a mean radiance over the exposure.

        Args:
            radiance_cd_m2: Linear BT.709 colour [cd/m²], shape (H, W, 3).
            product_s: Exposure times gain [s].
            stamp_ns: Time of the picture [ns]; keys its noise.
        """
        config = self.config
        exposure_s, gain = config.split(product_s)
        light = radiance_cd_m2
        if config.lens_blur_px:
            light = np.asarray(cv2.GaussianBlur(light, (5, 5), config.lens_blur_px), np.float32)
        light = mosaic(light) if config.bayer else light
        electrons = light * np.float32(config.electrons_per_cd_m2_s * exposure_s)
        electrons *= self._response
        if config.noise:
            generator = clock.stream(self._seed, f"{self._name}/noise", stamp_ns)
            lot = generator.standard_normal(electrons.shape, dtype=np.float32)
            electrons += lot * np.sqrt(electrons + np.float32(config.read_noise_e**2)) + self._offset_e
        top = (1 << config.adc_bits) - 1
        electrons *= np.float32(top * gain / config.full_well_e)
        numbers = np.clip(np.rint(electrons), 0, top).astype(np.uint16)
        if config.bayer:
            # OpenCV names a pattern after its second row and column.
            numbers = np.asarray(cv2.cvtColor(numbers, cv2.COLOR_BayerBG2RGB), np.uint16)
        picture: NDArray[np.uint8] = self._curve[numbers]
        return picture


def mosaic(radiance_cd_m2: F32) -> F32:
    """Light that passes each pixel's colour filter, RGGB from the upper left, shape (H, W)."""
    seen = radiance_cd_m2[..., 1].copy()
    seen[::2, ::2], seen[1::2, 1::2] = radiance_cd_m2[::2, ::2, 0], radiance_cd_m2[1::2, 1::2, 2]
    return seen


SAME_DEPTH = np.float32(0.10)
"""Depths that differ by less, as a ratio, are of the same surface."""
MISS_PX = np.float32(0.75)
"""A place that misses its pixel by more shows something else [px]."""
BOTH, FIRST, SECOND, NOWHERE = 0, 1, 2, 3
"""Which of two pictures show what a pixel sees in between."""
_ONE = np.float32(1)


@compiled
def sources(forward: Any, backward: Any, u: Any, v: Any, s: Any, ax: Any, ay: Any, bx: Any, by: Any) -> Any:
    """Where a pixel at time s came from in both pictures, from guesses, and which of them shows it.

    Where they show different surfaces the nearer one hides the other. A guess that leads nowhere is
    followed by that of a surface which moves all over as it does at the pixel itself.
    """
    rest = _ONE - s
    ax, ay, a_depth, a_miss = source_of(forward, u, v, s, ax, ay)
    if a_miss >= MISS_PX:
        ax, ay, a_depth, a_miss = source_of(forward, u, v, s, u, v)
    bx, by, b_depth, b_miss = source_of(backward, u, v, rest, bx, by)
    if b_miss >= MISS_PX:
        bx, by, b_depth, b_miss = source_of(backward, u, v, rest, u, v)
    kind = BOTH
    if a_miss >= MISS_PX or b_miss >= MISS_PX:
        kind = FIRST if a_miss < MISS_PX else SECOND if b_miss < MISS_PX else NOWHERE
        if a_miss >= MISS_PX and is_within(forward, ax, ay):
            ax, ay = u, v
        if b_miss >= MISS_PX and is_within(backward, bx, by):
            bx, by = u, v
    elif abs(a_depth - b_depth) > SAME_DEPTH * min(a_depth, b_depth):
        kind = FIRST if a_depth < b_depth else SECOND
    return ax, ay, bx, by, kind


@compiled
def is_within(field: Any, x: Any, y: Any) -> bool:
    """Whether a place lies in the picture."""
    inside: bool = x >= 0 and y >= 0 and x <= field.shape[1] - 1 and y <= field.shape[0] - 1
    return inside


SAMPLES_MAX = 64
"""Most samples in one exposure of a pixel."""


def exposed(before: F32, after: F32, motion: FrameMotion, shares: NDArray[np.float64]) -> F32:
    """Mean of a picture over every row's share of the time between two pictures.

    Args:
        before: Picture at the beginning, shape (H, W, C).
        after: Picture at the end, shape (H, W, C).
        motion: Motion in between.
        shares: Beginning and end of every row's light, 0 to 1 of the time, shape (H, 2).
    """
    out = np.empty_like(before)
    rows = np.clip(shares, 0.0, 1.0).astype(np.float32)
    given = before, after, motion.forward, motion.backward, rows, out
    over_bands(lambda first, end: _expose(*given, first, end), len(before))
    return out


def picked(
    before: NDArray[Any], after: NDArray[Any], motion: FrameMotion, shares: NDArray[np.float64]
) -> NDArray[Any]:
    """Value of the nearest pixel at the middle of every row's time, never between two; shape (H, W)."""
    out = np.empty_like(before)
    rows = np.clip(shares.mean(axis=1), 0.0, 1.0).astype(np.float32)
    given = before, after, motion.forward, motion.backward, rows, out
    over_bands(lambda first, end: _pick(*given, first, end), len(before))
    return out


@compiled
def _expose(
    before: Any, after: Any, forward: Any, backward: Any, rows: Any, out: Any, first: int, end: int
) -> None:
    for y in range(first, end):
        s0, s1 = rows[y, 0], rows[y, 1]
        for x in range(before.shape[1]):
            length = max(
                max(abs(forward[y, x, 0]), abs(forward[y, x, 1])),
                max(abs(backward[y, x, 0]), abs(backward[y, x, 1])),
            )
            count = min(max(math.ceil(length * (s1 - s0)), 1), SAMPLES_MAX)
            share = _ONE / np.float32(count)
            for channel in range(before.shape[2]):
                out[y, x, channel] = np.float32(0)
            for j in range(count):
                s = s0 + (s1 - s0) * share * (np.float32(j) + np.float32(0.5))
                ax, ay, bx, by, kind = _seen_at(forward, backward, y, x, s)
                weight = _ONE - s if kind == BOTH else _ONE if kind == FIRST else np.float32(0)
                for channel in range(before.shape[2]):
                    value = np.float32(0)
                    if kind != SECOND:
                        value += weight * _channel_between(before, ax, ay, channel)
                    if kind != FIRST:
                        value += (_ONE - weight) * _channel_between(after, bx, by, channel)
                    out[y, x, channel] += share * value


@compiled
def _pick(
    before: Any, after: Any, forward: Any, backward: Any, rows: Any, out: Any, first: int, end: int
) -> None:
    half = np.float32(0.5)
    for y in range(first, end):
        s = rows[y]
        for x in range(before.shape[1]):
            ax, ay, bx, by, kind = _seen_at(forward, backward, y, x, s)
            if kind == FIRST or (kind == BOTH and s < half):
                out[y, x] = before[int(ay + half), int(ax + half)]
            else:
                out[y, x] = after[int(by + half), int(bx + half)]


@inlined
def _seen_at(forward: Any, backward: Any, y: int, x: int, s: Any) -> Any:
    """Where both pictures show what a pixel sees at time s, and which does; itself where neither does."""
    u, v, rest = np.float32(x), np.float32(y), np.float32(1) - s
    ax, ay = u + s * backward[y, x, 0], v + s * backward[y, x, 1]
    bx, by = u + rest * forward[y, x, 0], v + rest * forward[y, x, 1]
    ax, ay, bx, by, kind = sources(forward, backward, u, v, s, ax, ay, bx, by)
    if kind == NOWHERE:
        ax, ay, bx, by, kind = u, v, u, v, BOTH
    return ax, ay, bx, by, kind


@compiled
def _channel_between(image: Any, x: Any, y: Any, channel: int) -> Any:
    """Value of one channel of a picture (H, W, C) between pixels."""
    i = min(np.uint32(x), np.uint32(image.shape[1] - 2))
    j = min(np.uint32(y), np.uint32(image.shape[0] - 2))
    k, m = i + np.uint32(1), j + np.uint32(1)
    a, b = x - np.float32(i), y - np.float32(j)
    upper = image[j, i, channel] + a * (image[j, k, channel] - image[j, i, channel])
    lower = image[m, i, channel] + a * (image[m, k, channel] - image[m, i, channel])
    return upper + b * (lower - upper)
