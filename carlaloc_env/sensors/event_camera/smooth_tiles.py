"""Kernel of the event camera: the signal of a smooth tile's pixels between two pictures."""

from __future__ import annotations

from typing import Any

import numpy as np

from carlaloc_env.core.jit import inlined
from carlaloc_env.sensors.event_camera.chunk_sampling import follow, travel
from carlaloc_env.sensors.event_camera.simd_state import CHUNK, arrive, look, mix, place, reaches
from carlaloc_env.sensors.event_camera.threshold_crossings import fire_samples, settle
from carlaloc_env.sensors.imaging.motion_warping import BOTH

_ONE, _ZERO = np.float32(1), np.float32(0)


@inlined
def fire_smooth(
    pictures: Any,
    noise: Any,
    numbers: Any,
    knots: Any,
    bounds: Any,
    steps: int,
    lanes: Any,
    marks: Any,
    out_t: Any,
    out_code: Any,
) -> None:
    """Events of sixteen pixels of a smooth tile, chunk by chunk.

    The picture nearer in time is followed; what the other says more of goes linearly in between.
    Chunks whose surroundings hold no intensity beyond the thresholds are passed over.
    """
    before, _, _, _, flat_before, flat_after = pictures
    span_us, refractory_us, _, _ = numbers
    height, width = np.int32(before.shape[0]), np.int32(before.shape[1])
    per_step, sample_us = _ONE / np.float32(steps), np.float64(span_us) / np.float64(steps)
    chunks = (steps + CHUNK - 1) // CHUNK if steps > 1 else 0
    placed = -1
    for k in range(chunks):
        if reaches(bounds[k, 0], bounds[k, 1], lanes) == 0:
            continue
        begin, stop = k * CHUNK, min(k * CHUNK + CHUNK, steps)
        for knot in range(k if placed != k else k + 1, k + 2):
            place(knots, knot, lanes)
            look(flat_before, width, height, np.int32(0), lanes)
            weight = _ZERO
            if bounds[knot, 2] == BOTH:
                look(flat_after, width, height, np.int32(1), lanes)
                weight = np.float32(min(knot * CHUNK, steps)) * per_step
            mix(weight, lanes)
        placed = k + 1
        second = begin + stop > steps and bounds[k, 2] == BOTH and bounds[k + 1, 2] == BOTH
        share = _ONE / np.float32(stop - begin)
        begun = np.float32(begin) * per_step
        where = follow(np.int32(second), share, begun, per_step, width, height, lanes)
        flat = flat_after if second else flat_before
        last = min(stop, steps - 1) - begin
        travel(flat, width, height, where, np.int32(last + 1), lanes)
        if stop == steps:
            last += 1
            arrive(np.int32(last), lanes)
        fire_samples(last, begin, noise, span_us, refractory_us, sample_us, lanes, marks, out_t, out_code)
    if steps == 1:
        arrive(np.int32(1), lanes)
        fire_samples(1, 0, noise, span_us, refractory_us, sample_us, lanes, marks, out_t, out_code)
    settle(span_us, refractory_us, sample_us, lanes, marks, out_t, out_code)
