"""Motion blur and rolling shutter: pixels between two drawn pictures, along the true motion.

Each row has its own times of exposure; the light of a pixel is the mean over them.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32
from carlaloc_env.core.cores import over_bands
from carlaloc_env.core.jit import compiled, inlined
from carlaloc_env.sensors.imaging.frame_motion import FrameMotion
from carlaloc_env.sensors.imaging.motion_field import source_of

SAME_DEPTH = np.float32(0.10)
"""Depths that differ by less, as a ratio, are of the same surface."""
MISS_PX = np.float32(0.75)
"""A place that misses its pixel by more shows something else [px]."""
BOTH, FIRST, SECOND, NOWHERE = 0, 1, 2, 3
"""Which of two pictures show what a pixel sees in between."""
_ONE = np.float32(1)
SAMPLES_MAX = 64
"""Most samples in one exposure of a pixel."""


@compiled
def sources(forward: Any, backward: Any, u: Any, v: Any, s: Any, ax: Any, ay: Any, bx: Any, by: Any) -> Any:
    """Places in both pictures of a pixel's surface at time s, from guesses, and the pictures that show it.

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
    """Places in both pictures of a pixel's surface at time s, and those that show it; itself if none does."""
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
