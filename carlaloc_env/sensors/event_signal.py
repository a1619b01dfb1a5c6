"""Kernels of the event camera: the signal of one pixel between two pictures."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from carlaloc_env.compiled import compiled
from carlaloc_env.sensors.event_crossing import cross
from carlaloc_env.sensors.event_tiles import CHUNK, STEPS_MAX
from carlaloc_env.sensors.pixel_motion import TILE_PX, bilinear
from carlaloc_env.sensors.pixel_ways import (
    BOTH,
    FIRST,
    NOWHERE,
    SECOND,
    hidden_by,
    mixed,
    range_along,
    sources,
)

CHUNK_BEHIND = 4
"""Samples between two places that are looked for, where something passes in front."""
_ONE, _ZERO = np.float32(1), np.float32(0)


@compiled
def fire_in_tile(
    pictures: Any,
    noise: Any,
    numbers: Any,
    on: Any,
    off: Any,
    y: int,
    x: int,
    where: Any,
    knots: Any,
    bounds: Any,
    steps: int,
    memory: Any,
    out_t: Any,
    out_code: Any,
) -> Any:
    """Signal of a pixel in a smooth tile."""
    before, after, ranges_before, ranges_after = pictures
    drift = numbers[2] * on
    pixel = y * before.shape[1] + x
    if steps == 1:
        levels = (before[y, x], after[y, x] + drift)
        return cross(noise, numbers, on, off, pixel, levels, 1, 1, memory, out_t, out_code)
    per_step = _ONE / np.float32(steps)
    slope = drift * per_step
    last = steps - 1
    # What the end of one chunk says holds at the beginning of the next; -1: nothing is known.
    placed, sampled = -1, -1
    earlier = before[y, x]
    ax, ay, bx, by = _ZERO, _ZERO, _ZERO, _ZERO
    for k in range((steps + CHUNK - 1) // CHUNK):
        if bounds[k, 1] + drift < memory[0] + on and bounds[k, 0] > memory[0] - off:
            continue
        begin, stop = k * CHUNK, min(k * CHUNK + CHUNK, steps)
        if placed != k:
            ax, ay, bx, by = _inside(knots, k, where)
        ex, ey, fx, fy = _inside(knots, k + 1, where)
        if k > 0 and sampled != k:
            kind = int(bounds[k, 2])
            earlier = mixed(before, after, kind, np.float32(begin) * per_step, ax, ay, bx, by, before[y, x])
        both = bounds[k, 2] == BOTH and bounds[k + 1, 2] == BOTH
        low, high = range_along(ranges_before, ax, ay, ex, ey, earlier, earlier)
        if both:
            low, high = range_along(ranges_after, bx, by, fx, fy, low, high)
        if stop == steps:
            low, high = min(low, after[y, x]), max(high, after[y, x])
        wx, wy, ux, uy = ax, ay, bx, by
        ax, ay, bx, by, placed = ex, ey, fx, fy, k + 1
        if high + drift < memory[0] + on and low > memory[0] - off:
            continue
        # The picture nearer in time is followed; what the other says more of goes linearly in between.
        share = _ONE / np.float32(stop - begin)
        own, dx, dy = before, share * (ex - wx), share * (ey - wy)
        more, grows = _ZERO, _ZERO
        if both:
            s1 = np.float32(stop) * per_step
            first_end, second_end = bilinear(before, ex, ey), bilinear(after, fx, fy)
            mean, own_end = (_ONE - s1) * first_end + s1 * second_end, first_end
            if begin + stop > steps:
                own, own_end = after, second_end
                wx, wy, dx, dy = ux, uy, share * (fx - ux), share * (fy - uy)
            more = earlier - bilinear(own, wx, wy)
            grows = (mean - own_end - more) * share
        upper, lower = memory[0] + on, memory[0] - off
        for j in range(begin + 1, stop + 1):
            now = after[y, x]
            if j <= last:
                f = np.float32(j - begin)
                now = bilinear(own, wx + f * dx, wy + f * dy) + (more + f * grows)
            to_level = now + slope * np.float32(j)
            if to_level >= upper or to_level <= lower:
                levels = (earlier + slope * np.float32(j - 1), to_level)
                memory = cross(noise, numbers, on, off, pixel, levels, j, steps, memory, out_t, out_code)
                upper, lower = memory[0] + on, memory[0] - off
            earlier = now
        sampled = k + 1
    return memory


@compiled
def _inside(knots: Any, k: int, where: Any) -> Any:
    """Places in both pictures between those of a tile's corners."""
    f, g = where
    w0, w1, w2, w3 = (_ONE - f) * (_ONE - g), f * (_ONE - g), (_ONE - f) * g, f * g
    return (
        w0 * knots[k, 0, 0] + w1 * knots[k, 1, 0] + w2 * knots[k, 2, 0] + w3 * knots[k, 3, 0],
        w0 * knots[k, 0, 1] + w1 * knots[k, 1, 1] + w2 * knots[k, 2, 1] + w3 * knots[k, 3, 1],
        w0 * knots[k, 0, 2] + w1 * knots[k, 1, 2] + w2 * knots[k, 2, 2] + w3 * knots[k, 3, 2],
        w0 * knots[k, 0, 3] + w1 * knots[k, 1, 3] + w2 * knots[k, 2, 3] + w3 * knots[k, 3, 3],
    )


@compiled
def fire_alone(
    pictures: Any,
    fields: Any,
    noise: Any,
    numbers: Any,
    on: Any,
    off: Any,
    y: int,
    x: int,
    memory: Any,
    out_t: Any,
    out_code: Any,
) -> Any:
    """Signal of a pixel near edges of depth, looked for on its own."""
    before, after, ranges_before, ranges_after = pictures
    forward, backward, passing = fields
    drift = numbers[2] * on
    pixel = y * before.shape[1] + x
    over = passing[y // TILE_PX, x // TILE_PX]
    steps, through = _steps(forward[y, x], backward[y, x], over, numbers[3])
    u, v, count = np.float32(x), np.float32(y), np.float32(steps)
    earlier = before[y, x]
    if steps == 1:
        levels = (earlier, after[y, x] + drift)
        return cross(noise, numbers, on, off, pixel, levels, 1, 1, memory, out_t, out_code)
    chunk = CHUNK_BEHIND if through else CHUNK
    # Slopes of both ways, per sample: first as if all were one surface, then as found.
    dax, day = backward[y, x, 0] / count, backward[y, x, 1] / count
    dbx, dby = -forward[y, x, 0] / count, -forward[y, x, 1] / count
    ax, ay, bx, by, kind = sources(
        forward, backward, u, v, _ZERO, u, v, u + forward[y, x, 0], v + forward[y, x, 1]
    )
    hidden = False
    k = 0
    while k < steps:
        stop = min(k + chunk, steps)
        px, py, qx, qy, was, was_hidden = ax, ay, bx, by, kind, hidden
        s, far = np.float32(stop) / count, np.float32(stop - k)
        ax, ay, bx, by, kind = sources(
            forward, backward, u, v, s, px + far * dax, py + far * day, qx + far * dbx, qy + far * dby
        )
        dax, day, dbx, dby = (ax - px) / far, (ay - py) / far, (bx - qx) / far, (by - qy) / far
        if through:
            hidden = hidden_by(before, forward, backward, over, u, v, s, ax, ay, bx, by, kind, _ZERO)[0]
        straight = kind == was and kind != NOWHERE and not hidden and not was_hidden
        if straight:
            low, high = earlier, earlier
            if kind != SECOND:
                low, high = range_along(ranges_before, px, py, ax, ay, low, high)
            if kind != FIRST:
                low, high = range_along(ranges_after, qx, qy, bx, by, low, high)
            if stop == steps:
                low, high = min(low, after[y, x]), max(high, after[y, x])
            if high + drift < memory[0] + on and low > memory[0] - off:
                if stop < steps:
                    earlier = mixed(before, after, kind, s, ax, ay, bx, by, earlier)
                k = stop
                continue
        cx, cy, ex, ey, sort = px, py, qx, qy, kind
        for j in range(k + 1, stop + 1):
            now = after[y, x]
            s = np.float32(j) / count
            if j < steps:
                if straight:
                    f = np.float32(j - k) / far
                    cx, cy = px + f * (ax - px), py + f * (ay - py)
                    ex, ey = qx + f * (bx - qx), qy + f * (by - qy)
                else:
                    cx, cy, ex, ey, sort = sources(forward, backward, u, v, s, cx, cy, ex, ey)
                now = mixed(before, after, sort, s, cx, cy, ex, ey, earlier)
                if through and not straight:
                    now = hidden_by(before, forward, backward, over, u, v, s, cx, cy, ex, ey, sort, now)[1]
            levels = (earlier + drift * (np.float32(j - 1) / count), now + drift * s)
            if levels[1] >= memory[0] + on or levels[1] <= memory[0] - off:
                memory = cross(noise, numbers, on, off, pixel, levels, j, steps, memory, out_t, out_code)
            earlier = now
        k = stop
    return memory


@compiled
def _steps(ahead: Any, back: Any, over: Any, step_px: Any) -> Any:
    """Number of samples of a pixel, and whether something nearer passes that neither picture shows there."""
    length = max(max(abs(ahead[0]), abs(ahead[1])), max(abs(back[0]), abs(back[1])))
    own = min(min(ahead[3], ahead[3] * ahead[2]), min(back[3], back[3] * back[2]))
    through = over[3] > 0 and min(over[3], over[3] * over[2]) < np.float32(0.8) * own
    if through:
        length = max(length, max(abs(over[0]), abs(over[1])))
    return min(max(math.ceil(length / step_px), 1), STEPS_MAX), through
