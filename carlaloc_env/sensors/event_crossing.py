"""Kernels of the event camera: when a pixel's signal makes it fire."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from carlaloc_env.compiled import compiled

NEVER_US = -(1 << 30)
"""Time of the last event of a pixel that has had none [µs]."""
_ONE, _ZERO = np.float32(1), np.float32(0)


@compiled
def any_crosses(levels: Any, count: int, upper: Any, lower: Any) -> bool:
    """Whether any of the first levels reaches one of two bounds."""
    hits = np.int32(0)
    for f in range(count):
        hits |= np.int32(levels[f] >= upper) | np.int32(levels[f] <= lower)
    found: bool = hits != 0
    return found


@compiled
def fire_levels(
    noise: Any,
    refractory_us: int,
    span_us: int,
    sample_us: float,
    on: Any,
    off: Any,
    pixel: int,
    begin: int,
    count: int,
    levels: Any,
    earlier: Any,
    memory: Any,
    out_t: Any,
    out_code: Any,
) -> Any:
    """Events of a pixel whose signal passes through levels, at the samples after `begin`.

    Args:
        noise: Noise events in the order of pixels: pixel, time [µs], polarity, first of each row of tiles.
        refractory_us: Shortest time between two events [µs].
        span_us: Length of the span [µs].
        sample_us: Time between two samples [µs].
        on: Threshold of positive events.
        off: Threshold of negative events.
        pixel: Index of the pixel.
        begin: Sample before the first level.
        count: Number of levels.
        levels: Signal, one number a sample.
        earlier: Signal at sample `begin`.
        memory: Level of the last event, its time, next noise event, number of events so far.
        out_t: Times of the events [µs].
        out_code: Pixel and polarity of the events.

    Returns:
        The memory afterwards.
    """
    reference, last, shot, filled = memory
    upper, lower = reference + on, reference - off
    noisy = shot < len(noise[0]) and noise[0][shot] == pixel
    for f in range(count):
        level = levels[f]
        while level >= upper or level <= lower:
            positive = level >= upper
            reference = upper if positive else lower
            upper, lower = reference + on, reference - off
            rise = level - earlier
            part = (reference - earlier) / rise if rise != _ZERO else _ONE
            part = min(max(part, _ZERO), _ONE)
            t: Any = min(max(np.int64(math.ceil((begin + f + np.float64(part)) * sample_us)), 1), span_us)
            if noisy:
                _, last, shot, filled = shots_until(
                    noise, refractory_us, pixel, t, (reference, last, shot, filled), out_t, out_code
                )
            if t - last >= refractory_us:
                last = t
                if filled < len(out_t):
                    out_t[filled] = t
                    out_code[filled] = (pixel << 1) | positive
                filled += 1
        earlier = level
    return reference, last, shot, filled


@compiled
def shots_until(
    noise: Any, refractory_us: int, pixel: int, t: int, memory: Any, out_t: Any, out_code: Any
) -> Any:
    """Noise events of a pixel up to a time [µs]."""
    shot_pixel, shot_t, shot_positive, _ = noise
    reference, last, shot, count = memory
    while shot < len(shot_pixel) and shot_pixel[shot] == pixel and shot_t[shot] <= t:
        if shot_t[shot] - last >= refractory_us:
            last = np.int64(shot_t[shot])
            if count < len(out_t):
                out_t[count] = last
                out_code[count] = (pixel << 1) | shot_positive[shot]
            count += 1
        shot += 1
    return reference, last, shot, count
