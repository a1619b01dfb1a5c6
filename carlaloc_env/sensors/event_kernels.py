"""Kernels of the event camera: what a pixel sees between two pictures, and when that makes it fire.

A pixel's signal is sampled at every `step_px` of motion. Where it comes from in both pictures is
looked for at the ends of chunks of samples; in between it moves straight on. In smooth tiles that
is done for the four corners only. Chunks whose surroundings hold no intensity beyond the pixel's
thresholds are passed over.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.compiled import compiled
from carlaloc_env.sensors.pixel_motion import TILE_PX, bilinear
from carlaloc_env.sensors.pixel_ways import (
    BOTH,
    FIRST,
    NOWHERE,
    SECOND,
    hidden_by,
    is_within,
    mixed,
    range_along,
    sources,
)

F32 = NDArray[np.float32]

STEPS_MAX = 512
"""Most samples of a pixel between two pictures."""
NEVER_US = -(1 << 30)
"""Time of the last event of a pixel that has had none [µs]."""
CHUNK = 16
"""Samples between two places that are looked for in both pictures."""
CHUNK_BEHIND = 4
"""The same where something passes in front."""
SMOOTH_PX = np.float32(0.3)
"""Motion in a smooth tile differs by less from what its corners say [px]."""
_ONE, _ZERO = np.float32(1), np.float32(0)


@compiled
def fire_rows(
    pictures: Any,
    fields: Any,
    device: Any,
    noise: Any,
    numbers: Any,
    scratch: Any,
    out_t: Any,
    out_code: Any,
    first: int,
    end: int,
) -> int:
    """Events of a band of rows, whole tiles, tile by tile; the number there is room for is kept.

    Returns:
        Number of events, more than `out_t` is long if there was too little room.
    """
    before, _, ranges_before, ranges_after = pictures
    passing = fields[2]
    reference_in, last_in, reference_out, last_out = device[2:]
    span_us, _, leaks, step_px = numbers
    knots, bounds = scratch
    height, width = before.shape
    count = 0
    for row in range(first // TILE_PX, (end + TILE_PX - 1) // TILE_PX):
        shot = noise[3][row]
        for column in range(passing.shape[1]):
            y0, x0 = row * TILE_PX, column * TILE_PX
            y1, x1 = min(y0 + TILE_PX, height) - 1, min(x0 + TILE_PX, width) - 1
            steps = _tile_steps(fields, row, column, y0, x0, y1, x1, step_px)
            if steps > 1 and not _tile_knots(fields, y0, x0, y1, x1, steps, knots, bounds):
                steps = 0
            low, high = _ZERO, _ZERO
            if steps > 0:
                low, high = _tile_bounds(ranges_before, ranges_after, row, column, knots, steps, bounds)
            for y in range(y0, y1 + 1):
                for x in range(x0, x1 + 1):
                    on, off = device[0][y, x], device[1][y, x]
                    reference, last = reference_in[y, x], last_in[y, x]
                    pixel = y * width + x
                    drift = leaks * on
                    memory = (reference, last, shot, count)
                    if steps == 0:
                        memory = _fire_alone(
                            pictures, fields, noise, numbers, on, off, y, x, memory, out_t, out_code
                        )
                    elif not (high + drift < reference + on and low > reference - off):
                        where = (
                            np.float32(x - x0) / max(np.float32(x1 - x0), _ONE),
                            np.float32(y - y0) / max(np.float32(y1 - y0), _ONE),
                        )
                        memory = _fire_in_tile(
                            pictures,
                            noise,
                            numbers,
                            on,
                            off,
                            y,
                            x,
                            where,
                            knots,
                            bounds,
                            steps,
                            memory,
                            out_t,
                            out_code,
                        )
                    reference, last, shot, count = _shots_until(
                        noise, numbers, pixel, span_us, memory, out_t, out_code
                    )
                    reference_out[y, x] = reference - drift
                    last_out[y, x] = max(last - span_us, NEVER_US)
    return count


@compiled
def _tile_steps(fields: Any, row: int, column: int, y0: int, x0: int, y1: int, x1: int, step_px: Any) -> int:
    """Samples of all pixels of a tile that moves smoothly; 0 where they must be looked at one by one."""
    forward, backward, passing = fields
    longest, nearest = _ZERO, np.float32(1e9)
    if not (_is_smooth(forward, y0, x0, y1, x1) and _is_smooth(backward, y0, x0, y1, x1)):
        return 0
    for field in (forward, backward):
        for y in (y0, y1):
            for x in (x0, x1):
                longest = max(longest, max(abs(field[y, x, 0]), abs(field[y, x, 1])))
                nearest = min(nearest, field[y, x, 3] * min(_ONE, field[y, x, 2]))
    over = passing[row, column]
    if over[3] > 0 and over[3] * min(_ONE, over[2]) < np.float32(0.8) * nearest:
        return 0
    steps: int = min(max(math.ceil(longest / step_px), 1), STEPS_MAX)
    return steps


@compiled
def _is_smooth(field: Any, y0: int, x0: int, y1: int, x1: int) -> bool:
    """Whether the motion of all pixels of a tile lies on the plane through those of its corners."""
    down, along = _ONE / np.float32(max(y1 - y0, 1)), _ONE / np.float32(max(x1 - x0, 1))
    for y in range(np.uint32(y0), np.uint32(y1 + 1)):
        g = down * (np.float32(y) - np.float32(y0))
        for part in (np.uint32(0), np.uint32(1)):
            left = field[y0, x0, part] + g * (field[y1, x0, part] - field[y0, x0, part])
            right = field[y0, x1, part] + g * (field[y1, x1, part] - field[y0, x1, part])
            rise = along * (right - left)
            for x in range(np.uint32(x0), np.uint32(x1 + 1)):
                if abs(left + (np.float32(x) - np.float32(x0)) * rise - field[y, x, part]) > SMOOTH_PX:
                    return False
    return True


@compiled
def _tile_knots(fields: Any, y0: int, x0: int, y1: int, x1: int, steps: int, knots: Any, bounds: Any) -> bool:
    """Fill in where the corners of a tile come from at the ends of all chunks; False if one is hidden."""
    forward, backward, _ = fields
    chunks = (steps + CHUNK - 1) // CHUNK
    for corner in range(4):
        y, x = y1 if corner >= 2 else y0, x1 if corner % 2 else x0
        u, v = np.float32(x), np.float32(y)
        ax, ay, bx, by = u, v, u + forward[y, x, 0], v + forward[y, x, 1]
        dax, day = backward[y, x, 0], backward[y, x, 1]
        dbx, dby = -forward[y, x, 0], -forward[y, x, 1]
        s0 = _ZERO
        for k in range(chunks + 1):
            s = np.float32(min(k * CHUNK, steps)) / np.float32(steps)
            f = s - s0
            px, py, qx, qy = ax, ay, bx, by
            ax, ay, bx, by, kind = sources(
                forward, backward, u, v, s, ax + f * dax, ay + f * day, bx + f * dbx, by + f * dby
            )
            # What has left the second picture may still be followed in the first.
            if kind != BOTH and not (kind == FIRST and not is_within(backward, bx, by)):
                return False
            if corner == 0 or kind == FIRST:
                bounds[k, 2] = kind
            if k > 0:
                dax, day, dbx, dby = (ax - px) / f, (ay - py) / f, (bx - qx) / f, (by - qy) / f
            s0 = s
            knots[k, corner, 0], knots[k, corner, 1] = ax, ay
            knots[k, corner, 2], knots[k, corner, 3] = bx, by
    return True


@compiled
def _tile_bounds(
    ranges_before: Any, ranges_after: Any, row: int, column: int, knots: Any, steps: int, bounds: Any
) -> Any:
    """Fill in the lowest and highest intensity that a tile meets in each chunk; those of all of them."""
    if steps == 1:
        low = min(ranges_before[row, column, 0], ranges_after[row, column, 0])
        high = max(ranges_before[row, column, 1], ranges_after[row, column, 1])
        bounds[0, 0], bounds[0, 1] = low, high
        return low, high
    lowest, highest = np.float32(1e9), np.float32(-1e9)
    chunks = (steps + CHUNK - 1) // CHUNK
    for k in range(chunks):
        low, high = np.float32(1e9), np.float32(-1e9)
        if k == chunks - 1:
            low, high = ranges_after[row, column, 0], ranges_after[row, column, 1]
        for part in range(2 if bounds[k, 2] == BOTH and bounds[k + 1, 2] == BOTH else 1):
            left, right = np.float32(1e9), _ZERO
            top, bottom = np.float32(1e9), _ZERO
            for knot in (k, k + 1):
                for corner in range(4):
                    x, y = knots[knot, corner, 2 * part], knots[knot, corner, 2 * part + 1]
                    left, right = min(left, x), max(right, x)
                    top, bottom = min(top, y), max(bottom, y)
            ranges = ranges_before if part == 0 else ranges_after
            low, high = range_along(ranges, left, top, right, bottom, low, high)
        bounds[k, 0], bounds[k, 1] = low, high
        lowest, highest = min(lowest, low), max(highest, high)
    return lowest, highest


@compiled
def _fire_in_tile(
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
        return _cross(noise, numbers, on, off, pixel, levels, 1, 1, memory, out_t, out_code)
    count = np.float32(steps)
    for k in range((steps + CHUNK - 1) // CHUNK):
        reference = memory[0]
        if bounds[k, 1] + drift < reference + on and bounds[k, 0] > reference - off:
            continue
        begin, stop = k * CHUNK, min(k * CHUNK + CHUNK, steps)
        ax, ay, bx, by = _inside(knots[k], where)
        ex, ey, fx, fy = _inside(knots[k + 1], where)
        earlier = before[y, x]
        if k > 0:
            kind = int(bounds[k, 2])
            earlier = mixed(before, after, kind, np.float32(begin) / count, ax, ay, bx, by, earlier)
        both = bounds[k, 2] == BOTH and bounds[k + 1, 2] == BOTH
        low, high = range_along(ranges_before, ax, ay, ex, ey, earlier, earlier)
        if both:
            low, high = range_along(ranges_after, bx, by, fx, fy, low, high)
        if stop == steps:
            low, high = min(low, after[y, x]), max(high, after[y, x])
        if high + drift < reference + on and low > reference - off:
            continue
        # The picture nearer in time is followed; what the other says more of goes linearly in between.
        s1 = np.float32(stop) / count
        own = before if begin + stop <= steps or not both else after
        if begin + stop <= steps or not both:
            wx, wy, zx, zy = ax, ay, ex, ey
        else:
            wx, wy, zx, zy = bx, by, fx, fy
        more, grows = _ZERO, _ZERO
        if both:
            more = earlier - bilinear(own, wx, wy)
            end = (_ONE - s1) * bilinear(before, ex, ey) + s1 * bilinear(after, fx, fy)
            grows = (end - bilinear(own, zx, zy) - more) / np.float32(stop - begin)
        share = _ONE / np.float32(stop - begin)
        dx, dy = share * (zx - wx), share * (zy - wy)
        for j in range(begin + 1, stop + 1):
            now = after[y, x]
            if j < steps:
                f = np.float32(j - begin)
                now = bilinear(own, wx + f * dx, wy + f * dy) + (more + f * grows)
            to_level = now + drift * (np.float32(j) / count)
            if to_level >= memory[0] + on or to_level <= memory[0] - off:
                levels = (earlier + drift * (np.float32(j - 1) / count), to_level)
                memory = _cross(noise, numbers, on, off, pixel, levels, j, steps, memory, out_t, out_code)
            earlier = now
    return memory


@compiled
def _inside(corners: Any, where: Any) -> Any:
    """Places in both pictures between those of a tile's corners."""
    f, g = where
    w0, w1, w2, w3 = (_ONE - f) * (_ONE - g), f * (_ONE - g), (_ONE - f) * g, f * g
    a, b, c, d = corners[0], corners[1], corners[2], corners[3]
    return (
        w0 * a[0] + w1 * b[0] + w2 * c[0] + w3 * d[0],
        w0 * a[1] + w1 * b[1] + w2 * c[1] + w3 * d[1],
        w0 * a[2] + w1 * b[2] + w2 * c[2] + w3 * d[2],
        w0 * a[3] + w1 * b[3] + w2 * c[3] + w3 * d[3],
    )


@compiled
def _fire_alone(
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
        return _cross(noise, numbers, on, off, pixel, levels, 1, 1, memory, out_t, out_code)
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
                memory = _cross(noise, numbers, on, off, pixel, levels, j, steps, memory, out_t, out_code)
            earlier = now
        k = stop
    return memory


@compiled
def _cross(
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
        _, last, shot, count = _shots_until(noise, numbers, pixel, t, memory, out_t, out_code)
        if t - last >= refractory_us:
            last = t
            if count < len(out_t):
                out_t[count] = t
                out_code[count] = (pixel << 1) | positive
            count += 1
        memory = (reference, last, shot, count)
    return memory


@compiled
def _shots_until(noise: Any, numbers: Any, pixel: int, t: int, memory: Any, out_t: Any, out_code: Any) -> Any:
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


@compiled
def _steps(ahead: Any, back: Any, over: Any, step_px: Any) -> Any:
    """Number of samples of a pixel, and whether something nearer passes that neither picture shows there."""
    length = max(max(abs(ahead[0]), abs(ahead[1])), max(abs(back[0]), abs(back[1])))
    own = min(min(ahead[3], ahead[3] * ahead[2]), min(back[3], back[3] * back[2]))
    through = over[3] > 0 and min(over[3], over[3] * over[2]) < np.float32(0.8) * own
    if through:
        length = max(length, max(abs(over[0]), abs(over[1])))
    return min(max(math.ceil(length / step_px), 1), STEPS_MAX), through


def new_scratch() -> tuple[F32, F32]:
    """Room for the notes that `fire_rows` takes of one tile.

    Where its corners come from at the ends of all chunks, x and y in both pictures; and for each
    chunk the lowest and highest intensity, and the kind at its beginning.
    """
    chunks = STEPS_MAX // CHUNK + 2
    return np.empty((chunks, 4, 4), np.float32), np.empty((chunks, 3), np.float32)
