"""Kernel of the event camera: the signal of a pixel near edges of depth, looked for on its own."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from carlaloc_env.compiled import compiled
from carlaloc_env.sensors.event_crossing import any_crosses, fire_levels
from carlaloc_env.sensors.event_sampling import sample
from carlaloc_env.sensors.event_tiles import CHUNK, STEPS_MAX
from carlaloc_env.sensors.pixel_motion import TILE_PX, bilinear
from carlaloc_env.sensors.pixel_ways import (
    BOTH,
    NOWHERE,
    SECOND,
    comes_over,
    mixed,
    over_place,
    range_along,
    sources,
)

CHUNK_BEHIND = 4
"""Samples between two places that are looked for, where something passes in front."""
_ONE, _ZERO = np.float32(1), np.float32(0)
_HIDDEN = 4


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
    levels: Any,
    memory: Any,
    out_t: Any,
    out_code: Any,
) -> Any:
    """Events of one pixel; the memory afterwards, as in `fire_levels`.

    Its way is straight from one place that is looked for to the next, as long as both are of the same
    kind; where they are not, the moment of the change is looked for by halves.
    """
    before, after, ranges_before, ranges_after = pictures
    forward, backward, passing = fields
    span_us, refractory_us, leaks, step_px = numbers
    height, width = before.shape
    flat_before, flat_after = before.reshape(height * width), after.reshape(height * width)
    drift = leaks * on
    pixel = y * width + x
    over = passing[y // TILE_PX, x // TILE_PX]
    steps, through = _steps(forward[y, x], backward[y, x], over, step_px)
    sample_us = np.float64(span_us) / np.float64(steps)
    upper, lower = memory[0] + on, memory[0] - off
    u, v, per_step = np.float32(x), np.float32(y), _ONE / np.float32(steps)
    slope = drift * per_step
    earlier, final = before[y, x], after[y, x]
    # Slopes of both ways, per sample: first as if all were one surface, then as found.
    dax, day = backward[y, x, 0] * per_step, backward[y, x, 1] * per_step
    dbx, dby = -forward[y, x, 0] * per_step, -forward[y, x, 1] * per_step
    px, py, qx, qy, was = u, v, u + forward[y, x, 0], v + forward[y, x, 1], NOWHERE
    hx, hy = u, v
    if steps > 1:
        px, py, qx, qy, was = sources(forward, backward, u, v, _ZERO, px, py, qx, qy)
    narrow = 0
    k, stop = 0, _next_stop(forward, over, u, v, 0, steps, through)
    while k < steps:
        far = np.float32(stop - k)
        s = np.float32(stop) * per_step
        ax, ay, bx, by, kind = u, v, u, v, was
        ox, oy = u, v
        if steps > 1:
            ax, ay, bx, by, kind = sources(
                forward, backward, u, v, s, px + far * dax, py + far * day, qx + far * dbx, qy + far * dby
            )
            found = kind
            if through:
                behind, ox, oy = over_place(forward, backward, over, u, v, s, ax, ay, bx, by, kind)
                kind = _HIDDEN if behind else kind
        else:
            found = NOWHERE
        if kind != was and stop - k > 1:
            narrow = (stop - k) >> 1
            stop = k + narrow
            continue
        share = _ONE / far
        sx, sy, tx, ty = px, py, qx, qy
        if kind == _HIDDEN:
            sx, sy = hx, hy
        ex, ey = (ox, oy) if kind == _HIDDEN else (ax, ay)
        begin, count = k, stop - k
        dax, day, dbx, dby = (ax - px) * share, (ay - py) * share, (bx - qx) * share, (by - qy) * share
        px, py, qx, qy, hx, hy = ax, ay, bx, by, ox, oy
        straight = kind == was and kind != NOWHERE
        was, k = kind, stop
        # Between a place of this kind and one of another known to come, the change is looked for by halves.
        narrow = max(narrow >> 1, min(narrow, 1)) if straight else 0
        stop = k + narrow if narrow > 0 else _next_stop(forward, over, u, v, k, steps, through)
        start = earlier
        if not straight:
            # One sample at a change of kind, or nothing to be seen.
            if kind == _HIDDEN:
                earlier = bilinear(before, ox, oy)
            else:
                earlier = mixed(before, after, found, s, ax, ay, bx, by, earlier)
            for f in range(count):
                levels[f] = earlier + slope * np.float32(begin + f + 1)
        else:
            low, high = earlier, earlier
            if kind != SECOND:
                low, high = range_along(ranges_before, sx, sy, ex, ey, low, high)
            if kind in (BOTH, SECOND):
                low, high = range_along(ranges_after, tx, ty, bx, by, low, high)
            if k == steps:
                low, high = min(low, final), max(high, final)
            more, grows, flat = _ZERO, _ZERO, flat_before
            ix, iy, jx, jy = sx, sy, ex, ey
            end = _ZERO
            if kind == BOTH:
                first, second = bilinear(before, ex, ey), bilinear(after, bx, by)
                end = (_ONE - s) * first + s * second
            if high + drift < upper and low > lower:
                earlier = (
                    end
                    if kind == BOTH
                    else bilinear(after, bx, by)
                    if kind == SECOND
                    else bilinear(before, ex, ey)
                )
                continue
            if kind == SECOND or (kind == BOTH and begin + k > steps):
                flat, ix, iy, jx, jy = flat_after, tx, ty, bx, by
            if kind == BOTH:
                own_begin, own_end = bilinear(before, ix, iy), first
                if begin + k > steps:
                    own_begin, own_end = bilinear(after, ix, iy), second
                more = earlier - own_begin
                grows = (end - own_end - more) * share
            sample(
                flat,
                np.int32(width),
                np.int32(height),
                ix,
                iy,
                share * (jx - ix),
                share * (jy - iy),
                more + slope * np.float32(begin),
                grows + slope,
                levels,
            )
            earlier = levels[count - 1] - slope * np.float32(k)
        if k == steps:
            levels[count - 1] = final + drift
        if any_crosses(levels, count, upper, lower):
            memory = fire_levels(
                noise,
                refractory_us,
                span_us,
                sample_us,
                on,
                off,
                pixel,
                begin,
                count,
                levels,
                start + slope * np.float32(begin),
                memory,
                out_t,
                out_code,
            )
            upper, lower = memory[0] + on, memory[0] - off
    return memory


@compiled
def _next_stop(forward: Any, over: Any, u: Any, v: Any, k: int, steps: int, through: bool) -> int:
    """Sample at which a pixel is looked for next: soon where something seems to pass in front."""
    if not through:
        return min(k + CHUNK, steps)
    stop = min(k + CHUNK_BEHIND, steps)
    for ahead in range(k + CHUNK_BEHIND, min(k + CHUNK, steps) + 1, CHUNK_BEHIND):
        if comes_over(forward, over, u, v, np.float32(ahead) / np.float32(steps)):
            break
        stop = ahead
    return stop


@compiled
def _steps(ahead: Any, back: Any, over: Any, step_px: Any) -> Any:
    """Number of samples of a pixel, and whether something nearer passes that neither picture shows there."""
    length = max(max(abs(ahead[0]), abs(ahead[1])), max(abs(back[0]), abs(back[1])))
    own = min(min(ahead[3], ahead[3] * ahead[2]), min(back[3], back[3] * back[2]))
    through = over[3] > 0 and min(over[3], over[3] * over[2]) < np.float32(0.8) * own
    if through:
        length = max(length, max(abs(over[0]), abs(over[1])))
    return min(max(math.ceil(length / step_px), 1), STEPS_MAX), through
