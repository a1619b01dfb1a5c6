"""Motion blur and rolling shutter: pixels between two drawn pictures, along the true motion.

Each row has its own times of exposure; the light of a pixel is the mean over them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32
from carlaloc_env.core.jit import compiled, inlined, over_bands
from carlaloc_env.sensors.imaging.frame_motion import FrameMotion
from carlaloc_env.sensors.imaging.motion_warping import BOTH, FIRST, NOWHERE, SECOND, sources

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
    one = np.float32(1)
    for y in range(first, end):
        s0, s1 = rows[y, 0], rows[y, 1]
        for x in range(before.shape[1]):
            length = max(
                max(abs(forward[y, x, 0]), abs(forward[y, x, 1])),
                max(abs(backward[y, x, 0]), abs(backward[y, x, 1])),
            )
            count = min(max(math.ceil(length * (s1 - s0)), 1), SAMPLES_MAX)
            share = one / np.float32(count)
            for channel in range(before.shape[2]):
                out[y, x, channel] = np.float32(0)
            for j in range(count):
                s = s0 + (s1 - s0) * share * (np.float32(j) + np.float32(0.5))
                ax, ay, bx, by, kind = _seen_at(forward, backward, y, x, s)
                weight = one - s if kind == BOTH else one if kind == FIRST else np.float32(0)
                for channel in range(before.shape[2]):
                    value = np.float32(0)
                    if kind != SECOND:
                        value += weight * _channel_between(before, ax, ay, channel)
                    if kind != FIRST:
                        value += (one - weight) * _channel_between(after, bx, by, channel)
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
