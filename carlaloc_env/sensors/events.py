"""The pixels of an event camera, after ESIM (Rebecq et al., "ESIM: an Open Event Camera Simulator", 2018).

A pixel keeps the log intensity of its last event and fires when the signal has moved away from it
by a threshold. Between two pictures the signal is sampled along the true motion of what the pixel
sees, so often that nothing moves by more than a pixel from one sample to the next.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env import rng
from carlaloc_env.samples import EVENT
from carlaloc_env.sensors.compiled import kernel, over_bands
from carlaloc_env.sensors.pixel_motion import TILE_PX, bilinear, motion_at, source_of

F32 = NDArray[np.float32]

STEPS_MAX = 512
"""Most samples of a pixel between two pictures."""
NEVER_US = -(1 << 30)
"""Time of the last event of a pixel that has had none [µs]."""
CHUNK = 16
"""Samples between two places that are looked for in both pictures."""
SAME_DEPTH = np.float32(0.10)
"""Depths that differ by less, as a ratio, are of the same surface."""
MISS_PX = np.float32(0.75)
"""A place that misses its pixel by more shows something else [px]."""
BOTH, FIRST, SECOND, NOWHERE = 0, 1, 2, 3
"""Which of two pictures show what a pixel sees in between."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pixels:
    """What differs between pixels and never changes."""

    on: F32
    """Rise of log intensity that makes a positive event, shape (H, W)."""
    off: F32
    """Fall of log intensity that makes a negative event, shape (H, W)."""

    @classmethod
    def draw(
        cls, seed: int, name: str, shape: tuple[int, int], on: float, off: float, sigma: float
    ) -> Pixels:
        """Pixels with normally scattered thresholds, none below 0.01."""
        generator = rng.stream(seed, f"{name}/threshold")
        scatter = sigma * generator.standard_normal((2, *shape), dtype=np.float32)
        low = np.float32(0.01)
        return cls(
            on=np.maximum(np.float32(on) + scatter[0], low), off=np.maximum(np.float32(off) + scatter[1], low)
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PixelState:
    """What pixels remember."""

    reference: F32
    """Log intensity of the last event, less what has leaked since, shape (H, W)."""
    last_us: NDArray[np.int32]
    """Time of the last event, counted from the moment of the state [µs], shape (H, W)."""

    @classmethod
    def begun(cls, log_intensity: F32, pixels: Pixels, seed: int, name: str, stamp_ns: int) -> PixelState:
        """State of a camera that has run for long: each reference anywhere within its thresholds."""
        lot = rng.stream(seed, f"{name}/begin", stamp_ns).random(log_intensity.shape, dtype=np.float32)
        reference = log_intensity + pixels.off - lot * (pixels.on + pixels.off)
        return cls(reference=reference, last_us=np.full(log_intensity.shape, NEVER_US, np.int32))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shots:
    """Events out of nothing, from photon and dark current noise, in the order of their pixels."""

    pixel: NDArray[np.int32]
    """Row-major index of the pixel, ascending, shape (N,)."""
    t_us: NDArray[np.int32]
    """Time from the beginning of the span [µs], shape (N,)."""
    positive: NDArray[np.bool_]
    """Polarity, shape (N,)."""

    @classmethod
    def draw(
        cls, seed: int, name: str, stamp_ns: int, shape: tuple[int, int], rate_hz: float, span_us: int
    ) -> Shots:
        """Poisson noise of a rate per pixel [Hz]; `stamp_ns` keys the span."""
        generator = rng.stream(seed, f"{name}/shot", stamp_ns)
        pixels = shape[0] * shape[1]
        count = int(generator.poisson(rate_hz * 1e-6 * span_us * pixels)) if rate_hz > 0 else 0
        pixel = generator.integers(0, pixels, count)
        t_us = generator.integers(1, span_us + 1, count)
        order = np.lexsort((t_us, pixel))
        return cls(
            pixel=pixel[order].astype(np.int32),
            t_us=t_us[order].astype(np.int32),
            positive=generator.random(count) < 0.5,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion:
    """How everything moves between two pictures, see `pixel_motion`."""

    forward: F32
    """Field of the first picture, towards the second, shape (H, W, 4)."""
    backward: F32
    """Field of the second picture, towards the first, shape (H, W, 4)."""
    passing: F32
    """Surfaces that pass over tiles, of the first picture, shape (h, w, 4)."""


def log_intensity(radiance_cd_m2: F32, dark_cd_m2: float, *, blurred: bool) -> F32:
    """Log of luminance plus dark current, in cd/m², shape (H, W).

    Args:
        radiance_cd_m2: Linear BT.709 colour [cd/m²], shape (H, W, 3).
        dark_cd_m2: Luminance whose photocurrent equals the dark current [cd/m²].
        blurred: Whether the lens' blur of 0.5 px is still missing from the picture.
    """
    shape = radiance_cd_m2.shape[:2]
    luminance, out = np.empty(shape, np.float32), np.empty(shape, np.float32)
    dark = np.float32(dark_cd_m2)
    over_bands(lambda first, end: _luminance(radiance_cd_m2, luminance, first, end), shape[0])
    side = np.float32(0.1065 if blurred else 0.0)
    over_bands(lambda first, end: _log_blurred(luminance, dark, side, out, first, end), shape[0])
    return out


@kernel
def _luminance(rgb: Any, out: Any, first: int, end: int) -> None:
    r, g, b = np.float32(0.2126), np.float32(0.7152), np.float32(0.0722)
    for y in range(first, end):
        for x in range(rgb.shape[1]):
            out[y, x] = r * rgb[y, x, 0] + g * rgb[y, x, 1] + b * rgb[y, x, 2]


@kernel
def _log_blurred(image: Any, dark: Any, side: Any, out: Any, first: int, end: int) -> None:
    height, width = image.shape
    middle = np.float32(1) - 2 * side
    for y in range(first, end):
        up, down = max(y - 1, 0), min(y + 1, height - 1)
        for x in range(width):
            left, right = max(x - 1, 0), min(x + 1, width - 1)
            a = side * (image[up, left] + image[up, right]) + middle * image[up, x]
            b = side * (image[y, left] + image[y, right]) + middle * image[y, x]
            c = side * (image[down, left] + image[down, right]) + middle * image[down, x]
            out[y, x] = log_of(side * (a + c) + middle * b + dark)


@kernel
def log_of(value: Any) -> Any:
    """Natural logarithm by + − × ÷ alone, the same bits on every CPU; error below 1e-7.

    ln(m·2^e) = e·ln 2 + 2·atanh((m − 1)/(m + 1)) for m from √½ to √2.
    """
    m, e = math.frexp(np.float64(value))
    if m < 0.7071067811865476:
        m, e = 2 * m, e - 1
    q = (m - 1) / (m + 1)
    w = q * q
    series = 1 + w * (1 / 3 + w * (1 / 5 + w * (1 / 7 + w * (1 / 9 + w / 11))))
    return np.float32(e * 0.6931471805599453 + 2 * q * series)


def fire(
    before: F32,
    after: F32,
    motion: Motion | None,
    state: PixelState,
    pixels: Pixels,
    shots: Shots,
    *,
    start_ns: int,
    span_us: int,
    refractory_us: int,
    leak_hz: float,
    step_px: float = 1.0,
) -> tuple[NDArray[np.void], PixelState]:
    """Events between two pictures, and the state after them.

    Args:
        before: Log intensity at the beginning, shape (H, W).
        after: Log intensity at the end, shape (H, W).
        motion: Motion in between; None: nothing moves, intensities change linearly.
        state: State at the beginning.
        pixels: Thresholds.
        shots: Noise events.
        start_ns: Time of the beginning [ns].
        span_us: Length of the span [µs].
        refractory_us: Shortest time between two events of a pixel [µs].
        leak_hz: Rate of positive events of a pixel in steady light [Hz].
        step_px: Farthest that anything moves between two samples [px].

    Returns:
        `EVENT` rows by time, whole µs after the beginning; events of the same time row by row. And the
        state at the end.
    """
    height, width = before.shape
    still = motion is None
    if motion is None:
        nothing = np.zeros((1, 1, 4), np.float32)
        motion = Motion(forward=nothing, backward=nothing, passing=nothing)
    reference, last_us = np.empty_like(state.reference), np.empty_like(state.last_us)
    first_shot = np.searchsorted(shots.pixel, np.arange(height + 1) * width).astype(np.int64)
    pictures = (before, after, _tile_ranges(before), _tile_ranges(after))
    fields = (motion.forward, motion.backward, motion.passing)
    device = (pixels.on, pixels.off, state.reference, state.last_us, reference, last_us)
    noise = (shots.pixel, shots.t_us, shots.positive, first_shot)
    numbers = (still, span_us, refractory_us, np.float32(leak_hz * 1e-6 * span_us), np.float32(step_px))

    def band(first: int, end: int) -> tuple[NDArray[np.int32], NDArray[np.uint32]]:
        room = 4 * (end - first) * width
        while True:
            t_us, code = np.empty(room, np.int32), np.empty(room, np.uint32)
            count = _fire_rows(pictures, fields, device, noise, numbers, t_us, code, first, end)
            if count <= room:
                return t_us[:count], code[:count]
            room = count

    parts = over_bands(band, height)
    t_us = np.concatenate([part[0] for part in parts])
    code = np.concatenate([part[1] for part in parts])
    events = np.empty(len(t_us), EVENT)
    _sort_by_time(t_us, code, width, span_us, start_ns, events)
    return events, PixelState(reference=reference, last_us=last_us)


@kernel
def _fire_rows(
    pictures: Any,
    fields: Any,
    device: Any,
    noise: Any,
    numbers: Any,
    out_t: Any,
    out_code: Any,
    first: int,
    end: int,
) -> int:
    before, after, ranges_before, ranges_after = pictures
    forward, backward, passing = fields
    on_at, off_at, reference_in, last_in, reference_out, last_out = device
    shot_pixel, shot_t, shot_positive, first_shot = noise
    still, span_us, refractory_us, leaks, step_px = numbers
    width = before.shape[1]
    one = np.float32(1)
    room, count = len(out_t), 0
    for y in range(first, end):
        shot, shots_end = first_shot[y], first_shot[y + 1]
        for x in range(width):
            pixel = y * width + x
            on, off = on_at[y, x], off_at[y, x]
            reference, last = reference_in[y, x], last_in[y, x]
            drift = leaks * on
            u, v = np.float32(x), np.float32(y)
            steps, through = 1, False
            if not still:
                over = passing[y // TILE_PX, x // TILE_PX]
                steps, through = _steps(forward[y, x], backward[y, x], over, step_px)
            chunk = steps if steps == 1 else CHUNK
            ax, ay, bx, by, kind = u, v, u, v, NOWHERE
            # Slopes of both ways, per sample: first as if all were one surface, then as found.
            dax, day, dbx, dby = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
            if steps > 1:
                share = one / np.float32(steps)
                dax, day = share * backward[y, x, 0], share * backward[y, x, 1]
                dbx, dby = -share * forward[y, x, 0], -share * forward[y, x, 1]
                bx, by = u + forward[y, x, 0], v + forward[y, x, 1]
                ax, ay, bx, by, kind = _sources(forward, backward, u, v, np.float32(0), ax, ay, bx, by)
            earlier = before[y, x]
            k = 0
            while k < steps:
                # A chunk of samples; where what is seen does not change its kind, it moves straight on.
                stop = min(k + chunk, steps)
                ax0, ay0, bx0, by0 = ax, ay, bx, by
                straight = False
                if steps > 1:
                    s = np.float32(stop) / np.float32(steps)
                    was, far = kind, np.float32(stop - k)
                    ax, ay, bx, by, kind = _sources(
                        forward,
                        backward,
                        u,
                        v,
                        s,
                        ax + far * dax,
                        ay + far * day,
                        bx + far * dbx,
                        by + far * dby,
                    )
                    dax, day, dbx, dby = (
                        (ax - ax0) / far,
                        (ay - ay0) / far,
                        (bx - bx0) / far,
                        (by - by0) / far,
                    )
                    straight = kind == was and kind != NOWHERE and not through
                if straight:
                    low, high = earlier, earlier
                    if kind != SECOND:
                        low, high = _range_along(ranges_before, ax0, ay0, ax, ay, low, high)
                    if kind != FIRST:
                        low, high = _range_along(ranges_after, bx0, by0, bx, by, low, high)
                    if stop == steps:
                        low, high = min(low, after[y, x]), max(high, after[y, x])
                    if high + drift < reference + on and low > reference - off:
                        if stop < steps:
                            earlier = _mixed(before, after, kind, s, ax, ay, bx, by, earlier)
                        k = stop
                        continue
                px, py, qx, qy, sort = ax0, ay0, bx0, by0, kind
                share = one / np.float32(stop - k)
                for j in range(k + 1, stop + 1):
                    if j == steps:
                        now = after[y, x]
                    else:
                        s = np.float32(j) / np.float32(steps)
                        if straight:
                            f = share * np.float32(j - k)
                            px, py = ax0 + f * (ax - ax0), ay0 + f * (ay - ay0)
                            qx, qy = bx0 + f * (bx - bx0), by0 + f * (by - by0)
                        else:
                            px, py, qx, qy, sort = _sources(forward, backward, u, v, s, px, py, qx, qy)
                        now = _mixed(before, after, sort, s, px, py, qx, qy, earlier)
                        if through:
                            now = _hidden_by(
                                before, forward, over, u, v, s, px, py, qx, qy, sort, backward, now
                            )
                    from_level = earlier + drift * (np.float32(j - 1) / np.float32(steps))
                    to_level = now + drift * (np.float32(j) / np.float32(steps))
                    while to_level >= reference + on or to_level <= reference - off:
                        positive = to_level >= reference + on
                        reference = reference + on if positive else reference - off
                        rise = to_level - from_level
                        part = (reference - from_level) / rise if rise != 0 else one
                        part = min(max(part, np.float32(0)), one)
                        t = math.ceil((np.float64(j - 1) + part) * span_us / steps)
                        t = min(max(t, 1), span_us)
                        while shot < shots_end and shot_pixel[shot] == pixel and shot_t[shot] <= t:
                            if shot_t[shot] - last >= refractory_us:
                                last = shot_t[shot]
                                if count < room:
                                    out_t[count] = last
                                    out_code[count] = (pixel << 1) | shot_positive[shot]
                                count += 1
                            shot += 1
                        if t - last >= refractory_us:
                            last = t
                            if count < room:
                                out_t[count] = t
                                out_code[count] = (pixel << 1) | positive
                            count += 1
                    earlier = now
                k = stop
            while shot < shots_end and shot_pixel[shot] == pixel:
                if shot_t[shot] - last >= refractory_us:
                    last = shot_t[shot]
                    if count < room:
                        out_t[count] = last
                        out_code[count] = (pixel << 1) | shot_positive[shot]
                    count += 1
                shot += 1
            reference_out[y, x] = reference - drift
            last_out[y, x] = max(last - span_us, NEVER_US)
    return count


@kernel
def _steps(ahead: Any, back: Any, over: Any, step_px: Any) -> Any:
    """Number of samples of a pixel, and whether something nearer passes that neither picture shows there."""
    length = max(max(abs(ahead[0]), abs(ahead[1])), max(abs(back[0]), abs(back[1])))
    own = min(min(ahead[3], ahead[3] * ahead[2]), min(back[3], back[3] * back[2]))
    through = over[3] > 0 and min(over[3], over[3] * over[2]) < np.float32(0.8) * own
    if through:
        length = max(length, max(abs(over[0]), abs(over[1])))
    return min(max(math.ceil(length / step_px), 1), STEPS_MAX), through


@kernel
def _sources(forward: Any, backward: Any, u: Any, v: Any, s: Any, ax: Any, ay: Any, bx: Any, by: Any) -> Any:
    """Where a pixel at time s came from in both pictures, from guesses, and which of them shows it.

    Where they show different surfaces the nearer one hides the other. A guess that leads nowhere is
    followed by that of a surface which moves all over as it does at the pixel itself.
    """
    rest = np.float32(1) - s
    ax, ay, a_depth, a_miss = source_of(forward, u, v, s, ax, ay)
    if a_miss >= MISS_PX:
        ax, ay, a_depth, a_miss = source_of(forward, u, v, s, u, v)
    bx, by, b_depth, b_miss = source_of(backward, u, v, rest, bx, by)
    if b_miss >= MISS_PX:
        bx, by, b_depth, b_miss = source_of(backward, u, v, rest, u, v)
    kind = BOTH
    if a_miss >= MISS_PX or b_miss >= MISS_PX:
        kind = FIRST if a_miss < MISS_PX else SECOND if b_miss < MISS_PX else NOWHERE
        if a_miss >= MISS_PX:
            ax, ay = u, v
        if b_miss >= MISS_PX:
            bx, by = u, v
    elif abs(a_depth - b_depth) > SAME_DEPTH * min(a_depth, b_depth):
        kind = FIRST if a_depth < b_depth else SECOND
    return ax, ay, bx, by, kind


@kernel
def _mixed(before: Any, after: Any, kind: Any, s: Any, ax: Any, ay: Any, bx: Any, by: Any, held: Any) -> Any:
    """Log intensity at time s from places in both pictures; `held` where neither shows it."""
    if kind == BOTH:
        return (np.float32(1) - s) * bilinear(before, ax, ay) + s * bilinear(after, bx, by)
    if kind == FIRST:
        return bilinear(before, ax, ay)
    if kind == SECOND:
        return bilinear(after, bx, by)
    return held


@kernel
def _hidden_by(
    before: Any,
    forward: Any,
    over: Any,
    u: Any,
    v: Any,
    s: Any,
    ax: Any,
    ay: Any,
    bx: Any,
    by: Any,
    kind: Any,
    backward: Any,
    value: Any,
) -> Any:
    """Log intensity of a surface that passes in front at time s, or else the value given."""
    tau = s * over[2] / ((np.float32(1) - s) + s * over[2])
    x, y, near, miss = source_of(forward, u, v, s, u - tau * over[0], v - tau * over[1])
    if miss >= MISS_PX:
        return value
    depth = np.float32(1e9)
    if kind in (BOTH, FIRST):
        depth = motion_at(forward, ax, ay)[3]
    elif kind == SECOND:
        depth = motion_at(backward, bx, by)[3]
    return bilinear(before, x, y) if near < np.float32(0.9) * depth else value


def _tile_ranges(image: F32) -> F32:
    """Lowest and highest value in each tile and one pixel around it, shape (h, w, 2)."""
    rows, columns = (-(-n // TILE_PX) for n in image.shape)
    ranges = np.empty((rows, columns, 2), np.float32)
    over_bands(lambda first, end: _fill_ranges(image, ranges, first, end), rows)
    return ranges


@kernel
def _fill_ranges(image: Any, ranges: Any, first: int, end: int) -> None:
    height, width = image.shape
    for row in range(first, end):
        for column in range(ranges.shape[1]):
            low, high = image[row * TILE_PX, column * TILE_PX], image[row * TILE_PX, column * TILE_PX]
            for y in range(max(row * TILE_PX - 1, 0), min((row + 1) * TILE_PX + 1, height)):
                for x in range(max(column * TILE_PX - 1, 0), min((column + 1) * TILE_PX + 1, width)):
                    low, high = min(low, image[y, x]), max(high, image[y, x])
            ranges[row, column, 0], ranges[row, column, 1] = low, high


@kernel
def _range_along(ranges: Any, x0: Any, y0: Any, x1: Any, y1: Any, low: Any, high: Any) -> Any:
    """Range widened to all values that a straight way between two places can meet."""
    left, right = int(min(x0, x1)) // TILE_PX, int(max(x0, x1)) // TILE_PX
    top, bottom = int(min(y0, y1)) // TILE_PX, int(max(y0, y1)) // TILE_PX
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            low = min(low, ranges[row, column, 0])
            high = max(high, ranges[row, column, 1])
    return low, high


@kernel
def _sort_by_time(t_us: Any, code: Any, width: int, span_us: int, start_ns: int, events: Any) -> None:
    """Counting sort that keeps the order of events of the same time."""
    place = np.zeros(span_us + 2, np.int64)
    for k in range(len(t_us)):
        place[t_us[k] + 1] += 1
    for t in range(span_us + 1):
        place[t + 1] += place[t]
    for k in range(len(t_us)):
        row = place[t_us[k]]
        place[t_us[k]] += 1
        pixel = code[k] >> 1
        events[row].t = start_ns + 1000 * t_us[k]
        events[row].x = pixel % width
        events[row].y = pixel // width
        events[row].p = code[k] & 1


def limit_rate(
    events: NDArray[np.void], start_ns: int, rate_max_hz: float, slot_us: int = 1000
) -> NDArray[np.void]:
    """Events that a read-out of limited rate lets through: evenly thinned in every slot of time.

    Args:
        events: Rows by time.
        start_ns: Beginning of the first slot [ns].
        rate_max_hz: Events per second that can be read [1/s].
        slot_us: Length of a slot [µs].
    """
    most = max(int(rate_max_hz * 1e-6 * slot_us), 1)
    slot = (events["t"] - start_ns - 1) // (1000 * slot_us)
    count = np.bincount(slot)
    if not len(count) or count.max() <= most:
        return events
    begin = np.cumsum(count) - count
    rank = np.arange(len(events)) - begin[slot]
    total = count[slot]
    # Of n events in a slot those stay at which floor(rank · most / n) goes up.
    kept = (total <= most) | ((rank + 1) * most // total > rank * most // total)
    result: NDArray[np.void] = events[kept]
    return result
