"""Kernels of the event camera: the signal of a tile's pixels between two pictures."""

from __future__ import annotations

from typing import Any

import numpy as np

from carlaloc_env.compiled import compiled
from carlaloc_env.sensors.event_crossing import NEVER_US, any_crosses, fire_levels, shots_until
from carlaloc_env.sensors.event_sampling import sample
from carlaloc_env.sensors.event_tiles import CHUNK
from carlaloc_env.sensors.pixel_motion import bilinear
from carlaloc_env.sensors.pixel_ways import BOTH

_ONE, _ZERO = np.float32(1), np.float32(0)


@compiled
def fire_tile(
    pictures: Any,
    device: Any,
    noise: Any,
    numbers: Any,
    knots: Any,
    bounds: Any,
    levels: Any,
    corners: Any,
    steps: int,
    shot: int,
    count: int,
    out_t: Any,
    out_code: Any,
) -> Any:
    """Events of all pixels of a smooth tile.

    Returns:
        Next noise event and number of events so far.
    """
    before, after, _, _ = pictures
    ons, offs, reference_in, last_in, reference_out, last_out = device
    span_us, refractory_us, leaks, _ = numbers
    y0, x0, y1, x1, low_tile, high_tile = corners
    height, width = before.shape
    flat_before, flat_after = before.reshape(height * width), after.reshape(height * width)
    per_step = _ONE / np.float32(steps)
    sample_us = np.float64(span_us) / np.float64(steps)
    chunks = (steps + CHUNK - 1) // CHUNK if steps > 1 else 0
    along, down = _ONE / max(np.float32(x1 - x0), _ONE), _ONE / max(np.float32(y1 - y0), _ONE)
    for y in range(y0, y1 + 1):
        g = np.float32(y - y0) * down
        for x in range(x0, x1 + 1):
            on, off = ons[y, x], offs[y, x]
            reference, last = reference_in[y, x], np.int64(last_in[y, x])
            drift = leaks * on
            upper, lower = reference + on, reference - off
            pixel = y * width + x
            if high_tile + drift >= upper or low_tile <= lower:
                slope = drift * per_step
                f = np.float32(x - x0) * along
                # What the end of one chunk says holds at the beginning of the next; -1: nothing is known.
                placed, known = -1, 0
                earlier = before[y, x]
                ax, ay, bx, by = _ZERO, _ZERO, _ZERO, _ZERO
                if steps == 1:
                    levels[0] = after[y, x] + drift
                    if any_crosses(levels, 1, upper, lower):
                        memory = (reference, last, shot, count)
                        reference, last, shot, count = fire_levels(
                            noise,
                            refractory_us,
                            span_us,
                            sample_us,
                            on,
                            off,
                            pixel,
                            0,
                            1,
                            levels,
                            earlier,
                            memory,
                            out_t,
                            out_code,
                        )
                for k in range(chunks):
                    if bounds[k, 1] + drift < upper and bounds[k, 0] > lower:
                        continue
                    begin, stop = k * CHUNK, min(k * CHUNK + CHUNK, steps)
                    if placed != k:
                        ax, ay, bx, by = _inside(knots, k, f, g)
                    ex, ey, fx, fy = _inside(knots, k + 1, f, g)
                    wx, wy, ux, uy = ax, ay, bx, by
                    ax, ay, bx, by, placed = ex, ey, fx, fy, k + 1
                    both = bounds[k, 2] == BOTH and bounds[k + 1, 2] == BOTH
                    if known != k:
                        earlier = bilinear(before, wx, wy)
                        if bounds[k, 2] == BOTH:
                            earlier += np.float32(begin) * per_step * (bilinear(after, ux, uy) - earlier)
                    level = earlier + slope * np.float32(begin)
                    earlier, known = (
                        _fill_levels(
                            before,
                            after,
                            flat_before,
                            flat_after,
                            (wx, wy, ux, uy),
                            (ex, ey, fx, fy),
                            both,
                            earlier,
                            begin,
                            stop,
                            steps,
                            slope,
                            levels,
                        ),
                        k + 1,
                    )
                    if stop == steps:
                        levels[stop - begin - 1] = after[y, x] + drift
                    if any_crosses(levels, stop - begin, upper, lower):
                        reference, last, shot, count = fire_levels(
                            noise,
                            refractory_us,
                            span_us,
                            sample_us,
                            on,
                            off,
                            pixel,
                            begin,
                            stop - begin,
                            levels,
                            level,
                            (reference, last, shot, count),
                            out_t,
                            out_code,
                        )
                        upper, lower = reference + on, reference - off
            if shot < len(noise[0]) and noise[0][shot] == pixel:
                reference, last, shot, count = shots_until(
                    noise, refractory_us, pixel, span_us, (reference, last, shot, count), out_t, out_code
                )
            reference_out[y, x] = reference - drift
            last_out[y, x] = max(last - span_us, NEVER_US)
    return shot, count


@compiled
def _fill_levels(
    before: Any,
    after: Any,
    flat_before: Any,
    flat_after: Any,
    places: Any,
    ends: Any,
    both: bool,
    earlier: Any,
    begin: int,
    stop: int,
    steps: int,
    slope: Any,
    levels: Any,
) -> Any:
    """Fill in the signal of one chunk from the places at its ends; what it is at the end, less the leak.

    The picture nearer in time is followed; what the other says more of goes linearly in between.
    """
    wx, wy, ux, uy = places
    ex, ey, fx, fy = ends
    share = _ONE / np.float32(stop - begin)
    flat, sx, sy, dx, dy = flat_before, wx, wy, share * (ex - wx), share * (ey - wy)
    more, grows, end = _ZERO, _ZERO, earlier
    if both:
        s1 = np.float32(stop) / np.float32(steps)
        first, second = bilinear(before, ex, ey), bilinear(after, fx, fy)
        end, own_end, own_begin = (_ONE - s1) * first + s1 * second, first, _ZERO
        if begin + stop > steps:
            flat, own_end, own_begin = flat_after, second, bilinear(after, ux, uy)
            sx, sy, dx, dy = ux, uy, share * (fx - ux), share * (fy - uy)
        else:
            own_begin = bilinear(before, wx, wy)
        more = earlier - own_begin
        grows = (end - own_end - more) * share
    leaked = slope * np.float32(begin)
    # As many levels as a chunk is long, whether it is full or not.
    sample(
        flat,
        np.int32(before.shape[1]),
        np.int32(before.shape[0]),
        sx,
        sy,
        dx,
        dy,
        more + leaked,
        grows + slope,
        levels,
    )
    return end if both else levels[stop - begin - 1] - slope * np.float32(stop)


@compiled
def _inside(knots: Any, k: int, f: Any, g: Any) -> Any:
    """Places in both pictures between those of a tile's corners."""
    w0, w1, w2, w3 = (_ONE - f) * (_ONE - g), f * (_ONE - g), (_ONE - f) * g, f * g
    return (
        w0 * knots[k, 0, 0] + w1 * knots[k, 1, 0] + w2 * knots[k, 2, 0] + w3 * knots[k, 3, 0],
        w0 * knots[k, 0, 1] + w1 * knots[k, 1, 1] + w2 * knots[k, 2, 1] + w3 * knots[k, 3, 1],
        w0 * knots[k, 0, 2] + w1 * knots[k, 1, 2] + w2 * knots[k, 2, 2] + w3 * knots[k, 3, 2],
        w0 * knots[k, 0, 3] + w1 * knots[k, 1, 3] + w2 * knots[k, 2, 3] + w3 * knots[k, 3, 3],
    )
