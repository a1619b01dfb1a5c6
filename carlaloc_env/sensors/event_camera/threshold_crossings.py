"""Kernels of the event camera: when the signal of sixteen pixels makes them fire.

Beside the numbers of `event_sampling` they keep whole ones, `LANES` in a row: times of the last
events [µs], and the next noise events.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from carlaloc_env.core.jit import compiled, inlined
from carlaloc_env.sensors.event_camera.crossing_queue import CODES, QUEUED, TIMES, timed, volley
from carlaloc_env.sensors.event_camera.simd import LANES
from carlaloc_env.sensors.event_camera.simd_state import (
    DRIFT,
    FINAL,
    LEVELS,
    LOWER,
    OFF,
    ON,
    REFERENCE,
    UPPER,
    gather,
    lowest,
    ready,
    scatter,
)
from carlaloc_env.sensors.imaging.motion_field import TILE_PX

NEVER_US = -(1 << 30)
"""Time of the last event of a pixel that has had none [µs]."""
LAST, SHOT, COUNT = 0, 1, 2
"""Rows of whole numbers; in the last one those below."""
EVENTS, NEXT_SHOT, NOISY, PLACE, WAITING = 0, 1, 2, 3, 4
"""Number of events so far, next noise event, pixels that have some as bits, the place of the first
pixel: its row in the upper 16 bits, its column in the lower; and number of crossings in the queue."""
PIXEL_ROWS = LANES // TILE_PX
"""Rows of pixels in sixteen of a tile."""
_ONE, _ZERO = np.float32(1), np.float32(0)


@inlined
def take_up(
    pictures: Any, device: Any, noise: Any, leaks: Any, corners: Any, row: int, lanes: Any, marks: Any
) -> None:
    """Begin with sixteen pixels of a tile, from one of its rows on; those beyond its edge never fire."""
    before, after, _, _, flat_before, flat_after = pictures
    ons, offs, references, last_in, _, _, flat_ons, flat_offs, flat_references, _ = device
    y0, x0, y1, x1 = corners
    width = before.shape[1]
    first = row * width + x0
    second = first + width
    whole = x1 - x0 == TILE_PX - 1 and row < y1
    if whole:
        gather(flat_ons, first, second, np.int32(ON), lanes)
        gather(flat_offs, first, second, np.int32(OFF), lanes)
        gather(flat_references, first, second, np.int32(REFERENCE), lanes)
        gather(flat_before, first, second, np.int32(LEVELS), lanes)
        gather(flat_after, first, second, np.int32(FINAL), lanes)
        for lane in range(TILE_PX):
            marks[LAST, lane] = last_in[row, x0 + lane]
            marks[LAST, TILE_PX + lane] = last_in[row + 1, x0 + lane]
    else:
        for lane in range(LANES):
            y, x = min(row + lane // TILE_PX, y1), min(x0 + lane % TILE_PX, x1)
            lanes[ON * LANES + lane], lanes[OFF * LANES + lane] = ons[y, x], offs[y, x]
            lanes[REFERENCE * LANES + lane] = references[y, x]
            lanes[LEVELS * LANES + lane], lanes[FINAL * LANES + lane] = before[y, x], after[y, x]
            marks[LAST, lane] = last_in[y, x]
    along, down = _ONE / np.float32(max(x1 - x0, 1)), _ONE / np.float32(max(y1 - y0, 1))
    top = np.float32(row - y0) * down
    ready(np.float32(x0), np.float32(row), along, down, top, leaks, lanes)
    if not whole:
        for lane in range(LANES):
            if row + lane // TILE_PX > y1 or x0 + lane % TILE_PX > x1:
                lanes[UPPER * LANES + lane] = np.float32(np.inf)
                lanes[LOWER * LANES + lane] = np.float32(-np.inf)
    marks[COUNT, PLACE] = row << 16 | x0
    _take_noise(noise[0], corners, row, marks)


@inlined
def _take_noise(places: Any, corners: Any, row: int, marks: Any) -> None:
    """Find the noise events of sixteen pixels."""
    _, x0, y1, x1 = corners
    shot, count = marks[COUNT, NEXT_SHOT], len(places)
    marks[COUNT, NOISY] = 0
    if shot >= count:
        return
    y, x = places[shot] >> 16, places[shot] & 0xFFFF
    if y < row or y >= row + PIXEL_ROWS or x < x0 or x > x1:
        return
    noisy = 0
    for lane in range(LANES):
        marks[SHOT, lane] = count
        y, x = row + lane // TILE_PX, x0 + lane % TILE_PX
        if y <= y1 and x <= x1 and shot < count and places[shot] == place_of(lane, marks):
            marks[SHOT, lane] = shot
            noisy |= 1 << lane
            while shot < count and places[shot] == place_of(lane, marks):
                shot += 1
    marks[COUNT, NOISY] = noisy
    marks[COUNT, NEXT_SHOT] = shot


@inlined
def put_down(
    device: Any,
    noise: Any,
    span_us: int,
    refractory_us: int,
    corners: Any,
    row: int,
    lanes: Any,
    marks: Any,
    out_t: Any,
    out_code: Any,
) -> None:
    """Leave sixteen pixels at the end of the span: their last noise, and what they remember."""
    reference_out, last_out = device[4], device[5]
    _, x0, y1, x1 = corners
    if marks[COUNT, NOISY] != 0:
        for lane in range(LANES):
            if marks[SHOT, lane] < len(noise[0]):
                _shots_until(noise, refractory_us, lane, span_us, marks, out_t, out_code)
    if x1 - x0 == TILE_PX - 1 and row < y1:
        width = reference_out.shape[1]
        first = row * width + x0
        scatter(lanes, device[9], first, first + width)
        for lane in range(TILE_PX):
            last_out[row, x0 + lane] = max(marks[LAST, lane] - span_us, NEVER_US)
            last_out[row + 1, x0 + lane] = max(marks[LAST, TILE_PX + lane] - span_us, NEVER_US)
        return
    for lane in range(LANES):
        y, x = row + lane // TILE_PX, x0 + lane % TILE_PX
        if y <= y1 and x <= x1:
            reference_out[y, x] = lanes[REFERENCE * LANES + lane] - lanes[DRIFT * LANES + lane]
            last_out[y, x] = max(marks[LAST, lane] - span_us, NEVER_US)


@inlined
def fire_samples(
    count: int,
    before: int,
    noise: Any,
    span_us: int,
    refractory_us: int,
    sample_us: float,
    lanes: Any,
    marks: Any,
    out_t: Any,
    out_code: Any,
) -> None:
    """Events that some samples of a chunk make; `settle` tells the last of them.

    Args:
        count: Number of samples, whose signals follow that of the sample before them.
        before: Number of the sample before them.
        noise: Noise events in the order of tiles: place, time [µs], polarity, first of each row of tiles.
        span_us: Length of the span [µs].
        refractory_us: Shortest time between two events [µs].
        sample_us: Time between two samples [µs].
        lanes: Numbers of the pixels, see `event_sampling`.
        marks: Whole numbers of the pixels.
        out_t: Times of the events [µs].
        out_code: Place of the events' pixels, and in the lowest bit their polarity.
    """
    step, noisy = 1, np.int32(marks[COUNT, NOISY])
    while step <= count:
        waiting = np.int32(marks[COUNT, WAITING])
        found = volley(np.int32(step), np.int32(count + 1), np.int32(before), noisy, waiting, lanes, marks)
        step = found >> 32
        marks[COUNT, WAITING] = found >> 16 & 0xFFFF
        if step <= count:
            bits = found & 0xFFFF
            _halt(bits, step, before, noise, span_us, refractory_us, sample_us, lanes, marks, out_t, out_code)
            step += bits != 0


@compiled
def _halt(
    bits: int,
    step: int,
    before: int,
    noise: Any,
    span_us: int,
    refractory_us: int,
    sample_us: float,
    lanes: Any,
    marks: Any,
    out_t: Any,
    out_code: Any,
) -> None:
    """Tell all events so far, those of some noisy pixels at a sample included."""
    settle(span_us, refractory_us, sample_us, lanes, marks, out_t, out_code)
    if bits != 0:
        _fire_one_by_one(
            bits, step, before, noise, span_us, refractory_us, sample_us, lanes, marks, out_t, out_code
        )


@inlined
def settle(
    span_us: int, refractory_us: int, sample_us: float, lanes: Any, marks: Any, out_t: Any, out_code: Any
) -> None:
    """Tell the events of all crossings in the queue, but for those that come too soon after another."""
    count, waiting = marks[COUNT, EVENTS], marks[COUNT, WAITING]
    for row in range((waiting + LANES - 1) // LANES):
        timed(np.int32(row), sample_us, np.int32(span_us), np.int32(marks[COUNT, PLACE]), lanes, marks)
        for k in range(min(waiting - row * LANES, LANES)):
            lane, t = marks[QUEUED + row, k] & LANES - 1, marks[TIMES, k]
            if t - marks[LAST, lane] >= refractory_us:
                marks[LAST, lane] = t
                if count < len(out_t):
                    out_t[count], out_code[count] = t, marks[CODES, k]
                count += 1
    marks[COUNT, EVENTS], marks[COUNT, WAITING] = count, 0


@inlined
def _fire_one_by_one(
    bits: int,
    step: int,
    before: int,
    noise: Any,
    span_us: int,
    refractory_us: int,
    sample_us: float,
    lanes: Any,
    marks: Any,
    out_t: Any,
    out_code: Any,
) -> None:
    """Events of some pixels at a sample, and their noise events until then."""
    while bits != 0:
        lane = lowest(np.int32(bits))
        bits &= bits - 1
        level, earlier = lanes[(LEVELS + step) * LANES + lane], lanes[(LEVELS + step - 1) * LANES + lane]
        on, off = lanes[ON * LANES + lane], lanes[OFF * LANES + lane]
        upper, lower = lanes[UPPER * LANES + lane], lanes[LOWER * LANES + lane]
        reference = lanes[REFERENCE * LANES + lane]
        rise = level - earlier
        while level >= upper or level <= lower:
            positive = level >= upper
            reference = upper if positive else lower
            upper, lower = reference + on, reference - off
            part = (reference - earlier) / rise if rise != _ZERO else _ONE
            part = min(max(part, _ZERO), _ONE)
            at = np.float64(before + step - 1) + np.float64(part)
            t: Any = min(max(np.int64(math.ceil(at * sample_us)), 1), span_us)
            if marks[SHOT, lane] < len(noise[0]):
                _shots_until(noise, refractory_us, lane, t, marks, out_t, out_code)
            if t - marks[LAST, lane] >= refractory_us:
                _note(lane, t, positive, marks, out_t, out_code)
        lanes[REFERENCE * LANES + lane] = reference
        lanes[UPPER * LANES + lane], lanes[LOWER * LANES + lane] = upper, lower


@inlined
def place_of(lane: int, marks: Any) -> int:
    """Row of one of the sixteen pixels in the upper 16 bits, column in the lower."""
    place: int = marks[COUNT, PLACE] + (lane // TILE_PX << 16) + lane % TILE_PX
    return place


@inlined
def _note(lane: int, t: int, positive: bool, marks: Any, out_t: Any, out_code: Any) -> None:
    """Keep an event, if there is room for it; count it in any case."""
    count = marks[COUNT, EVENTS]
    marks[LAST, lane] = t
    if count < len(out_t):
        out_t[count] = t
        out_code[count] = (place_of(lane, marks) << 1) | positive
    marks[COUNT, EVENTS] = count + 1


@inlined
def _shots_until(
    noise: Any, refractory_us: int, lane: int, t: int, marks: Any, out_t: Any, out_code: Any
) -> None:
    """Noise events of a pixel up to a time [µs]."""
    shot_place, shot_t, shot_positive, _ = noise
    shot = marks[SHOT, lane]
    while shot < len(shot_place) and shot_place[shot] == place_of(lane, marks) and shot_t[shot] <= t:
        if shot_t[shot] - marks[LAST, lane] >= refractory_us:
            _note(lane, shot_t[shot], shot_positive[shot], marks, out_t, out_code)
        shot += 1
    marks[SHOT, lane] = shot
