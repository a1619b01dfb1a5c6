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
def cross(
    noise: Any,
    numbers: Any,
    on: Any,
    off: Any,
    pixel: int,
    levels: Any,
    j: int,
    steps: int,
    memory: Any,
    out_t: Any,
    out_code: Any,
) -> Any:
    """Events of a pixel whose signal goes from one level to another in sample j of all its steps."""
    span_us, refractory_us = numbers[0], numbers[1]
    from_level, to_level = levels
    rise = to_level - from_level
    while to_level >= memory[0] + on or to_level <= memory[0] - off:
        positive = to_level >= memory[0] + on
        reference = memory[0] + on if positive else memory[0] - off
        part = (reference - from_level) / rise if rise != 0 else _ONE
        part = min(max(part, _ZERO), _ONE)
        t = min(max(math.ceil((np.float64(j - 1) + part) * span_us / steps), 1), span_us)
        _, last, shot, count = shots_until(noise, numbers, pixel, t, memory, out_t, out_code)
        if t - last >= refractory_us:
            last = t
            if count < len(out_t):
                out_t[count] = t
                out_code[count] = (pixel << 1) | positive
            count += 1
        memory = (reference, last, shot, count)
    return memory


@compiled
def shots_until(noise: Any, numbers: Any, pixel: int, t: int, memory: Any, out_t: Any, out_code: Any) -> Any:
    """Noise events of a pixel up to a time [µs]."""
    shot_pixel, shot_t, shot_positive, _ = noise
    refractory_us = numbers[1]
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
