"""Firing of the pixels of an event camera, after ESIM.

Rebecq, Gehrig, Scaramuzza, "ESIM: an Open Event Camera Simulator", 2018: a pixel keeps the log intensity of
its last event, its reference, and fires when its signal has moved away from it by a threshold C.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32, I32, U32
from carlaloc_env.core.cores import over_bands
from carlaloc_env.core.jit import compiled, inlined
from carlaloc_env.sensors.event_camera.motion_sampling import new_track, sample_signal
from carlaloc_env.sensors.event_camera.pixels import (
    NEVER_US,
    NoiseEvents,
    PixelState,
    Thresholds,
)
from carlaloc_env.sensors.event_camera.read_out import by_time
from carlaloc_env.sensors.event_camera.tile_survey import (
    CHUNK,
    ONE,
    ZERO,
    Fields,
    Pictures,
    Tile,
    new_notes,
    survey,
    tile_ranges,
)
from carlaloc_env.sensors.imaging.frame_motion import FrameMotion
from carlaloc_env.sensors.imaging.motion_field import TILE_PX

ROOM = 16
"""Events per pixel that a band of rows has room for at first: unused room takes no memory."""


class PixelArrays(NamedTuple):
    """Thresholds of all pixels, and their state, which the kernel takes from the beginning to the end."""

    on: Any
    off: Any
    reference: Any
    last_us: Any


class NoiseArrays(NamedTuple):
    """Noise events in the order of their pixels, and the next event of each row of pixels."""

    pixel: Any
    t_us: Any
    positive: Any
    next_of_row: Any


class Settings(NamedTuple):
    """Numbers that all pixels share."""

    span_us: Any
    """Time between the pictures [µs]."""
    refractory_us: Any
    """Shortest time between two events of a pixel [µs]."""
    leak: Any
    """What leaks in the span, as a share of the positive threshold."""
    step_px: Any
    """Farthest that anything moves between two samples [px]."""


class Span(NamedTuple):
    """Inputs of the kernel: pictures, motion, pixels and noise of the span between two pictures."""

    pictures: Any
    fields: Any
    pixels: Any
    noise: Any
    settings: Any


class EventBuffer(NamedTuple):
    """Events of a band, as many as there is room for."""

    t_us: Any
    """Times from the beginning of the span [µs]."""
    code: Any
    """y · 2^17 + x · 2 + p of each."""
    count: Any
    """Number of events, those without room included, shape (1,)."""


def generate_events(
    before: F32,
    after: F32,
    motion: FrameMotion | None,
    state: PixelState,
    thresholds: Thresholds,
    noise: NoiseEvents,
    *,
    start_ns: int,
    span_us: int,
    refractory_us: int,
    leak_hz: float,
    step_px: float = 1.0,
) -> tuple[NDArray[np.void], PixelState]:
    """Events between two pictures, and the state after them.

    The signal is sampled along the true motion, so often that nothing moves by more than a pixel from one
    sample to the next (ESIM's adaptive sampling by displacement), and changes linearly in between, L(k − 1)
    to L(k). So an event comes (reference ± C − L(k − 1)) / (L(k) − L(k − 1)) of the step after t(k − 1).
    A leak current lets the signal rise evenly, by C of positive events in each 1 / leak rate. Noise events
    come beside. After an event a pixel is dead for the refractory time: events within it are lost.

    Args:
        before: Log intensity at the beginning, shape (H, W).
        after: Log intensity at the end, shape (H, W).
        motion: Motion in between; None: nothing moves, intensities change linearly.
        state: State at the beginning.
        thresholds: Contrast thresholds.
        noise: Noise events of the span.
        start_ns: Time of the beginning [ns].
        span_us: Length of the span [µs].
        refractory_us: Shortest time between two events of a pixel [µs].
        leak_hz: Rate of positive events of a pixel in steady light [Hz].
        step_px: Farthest that anything moves between two samples [px].

    Returns:
        `EVENT` rows by time, whole µs after the beginning; events of the same time tile by tile. And the
        state at the end.
    """
    height, width = before.shape
    motion = motion or FrameMotion.none(before.shape)
    following = PixelState(reference=np.empty_like(state.reference), last_us=np.empty_like(state.last_us))
    first_of_row = np.searchsorted(noise.pixel, np.arange(height) * width)
    span = Span(
        Pictures(before, after, tile_ranges(before), tile_ranges(after)),
        Fields(motion.forward, motion.backward, motion.passing),
        PixelArrays(thresholds.on, thresholds.off, following.reference, following.last_us),
        NoiseArrays(noise.pixel, noise.t_us, noise.positive, np.empty_like(first_of_row)),
        Settings(span_us, refractory_us, np.float32(leak_hz * 1e-6 * span_us), np.float32(step_px)),
    )

    def band(first: int, end: int) -> tuple[I32, U32]:
        room = ROOM * (end - first) * width
        while True:
            rows = slice(first, end)
            span.pixels.reference[rows] = state.reference[rows]
            span.pixels.last_us[rows] = state.last_us[rows]
            span.noise.next_of_row[rows] = first_of_row[rows]
            t_us, code, count = np.empty(room, np.int32), np.empty(room, np.uint32), np.zeros(1, np.int64)
            levels = np.zeros(CHUNK + 1, np.float32)
            _fire_rows(span, new_notes(), new_track(), levels, EventBuffer(t_us, code, count), first, end)
            if count[0] <= room:
                return t_us[: count[0]], code[: count[0]]
            # Too little room: all over again, with enough.
            room = int(count[0])

    parts = over_bands(band, height)
    events = by_time([t_us for t_us, _ in parts], [code for _, code in parts], start_ns, span_us)
    return events, following


@compiled
def _fire_rows(span: Any, notes: Any, track: Any, levels: Any, events: Any, first: int, end: int) -> None:
    """Events of a band of rows, tile by tile; tiles that do not move smoothly are cut into quarters."""
    pictures, fields, step_px = span.pictures, span.fields, span.settings.step_px
    height, width = pictures.before.shape
    half = TILE_PX // 2
    for y0 in range(first, end, TILE_PX):
        for x0 in range(0, width, TILE_PX):
            y1, x1 = min(y0 + TILE_PX, height) - 1, min(x0 + TILE_PX, width) - 1
            tile = Tile(y0, x0, y1, x1)
            motion = survey(pictures, fields, tile, step_px, notes)
            if motion.smooth:
                _fire_tile(span, tile, motion, notes, track, levels, events)
                continue
            for top in range(y0, y1 + 1, half):
                for left in range(x0, x1 + 1, half):
                    tile = Tile(top, left, min(top + half - 1, y1), min(left + half - 1, x1))
                    motion = survey(pictures, fields, tile, step_px, notes)
                    _fire_tile(span, tile, motion, notes, track, levels, events)


@compiled
def _fire_tile(span: Any, tile: Any, motion: Any, notes: Any, track: Any, levels: Any, events: Any) -> None:
    """Events of a tile's pixels, one after another, over the whole span."""
    for y in range(tile.y0, tile.y1 + 1):
        for x in range(tile.x0, tile.x1 + 1):
            for k in range((motion.steps + CHUNK - 1) // CHUNK):
                if _can_fire(span, y, x, notes.bounds[k, 0], notes.bounds[k, 1]):
                    pictures, fields = span.pictures, span.fields
                    count = sample_signal(pictures, fields, tile, motion, notes, y, x, k, track, levels)
                    _fire_chunk(span, y, x, k * CHUNK, motion.steps, levels[: count + 1], events)
            _fire_noise(span, y, x, span.settings.span_us, events)
            pixels = span.pixels
            pixels.reference[y, x] -= span.settings.leak * pixels.on[y, x]
            pixels.last_us[y, x] = max(pixels.last_us[y, x] - span.settings.span_us, NEVER_US)


@inlined
def _can_fire(span: Any, y: int, x: int, low: Any, high: Any) -> bool:
    """Whether a signal between two levels, and the leak, can reach a threshold."""
    pixels = span.pixels
    on, off, reference = pixels.on[y, x], pixels.off[y, x], pixels.reference[y, x]
    can: bool = high + span.settings.leak * on >= reference + on or low <= reference - off
    return can


@inlined
def _fire_chunk(span: Any, y: int, x: int, begin: int, steps: int, levels: Any, events: Any) -> None:
    """Events of a pixel along the samples of a chunk, which continues from sample `begin` of all `steps`."""
    pixels = span.pixels
    on, off = pixels.on[y, x], pixels.off[y, x]
    upper, lower = pixels.reference[y, x] + on, pixels.reference[y, x] - off
    slope = span.settings.leak * on / np.float32(steps)
    for j in range(1, len(levels)):
        level = levels[j] + slope * np.float32(begin + j)
        if level >= upper or level <= lower:
            earlier = levels[j - 1] + slope * np.float32(begin + j - 1)
            _cross(span, y, x, begin + j, steps, earlier, level, events)
            upper, lower = pixels.reference[y, x] + on, pixels.reference[y, x] - off


@inlined
def _cross(span: Any, y: int, x: int, sample: int, steps: int, earlier: Any, level: Any, events: Any) -> None:
    """Events of a pixel whose signal changes linearly between two levels in one of all its steps."""
    pixels, span_us = span.pixels, span.settings.span_us
    on, off, reference = pixels.on[y, x], pixels.off[y, x], pixels.reference[y, x]
    rise = level - earlier
    while level >= reference + on or level <= reference - off:
        positive = level >= reference + on
        reference = reference + on if positive else reference - off
        part = (reference - earlier) / rise if rise != 0 else ONE
        part = min(max(part, ZERO), ONE)
        t_us = math.ceil((np.float64(sample - 1) + part) * span_us / steps)
        t_us = min(max(t_us, 1), span_us)
        _fire_noise(span, y, x, t_us, events)
        _fire(span, y, x, t_us, positive, events)
    pixels.reference[y, x] = reference


@inlined
def _fire_noise(span: Any, y: int, x: int, until_us: int, events: Any) -> None:
    """Noise events of a pixel up to a time [µs]."""
    noise, pixel = span.noise, y * span.pictures.before.shape[1] + x
    n = noise.next_of_row[y]
    while n < len(noise.pixel) and noise.pixel[n] == pixel and noise.t_us[n] <= until_us:
        _fire(span, y, x, noise.t_us[n], noise.positive[n], events)
        n += 1
    noise.next_of_row[y] = n


@inlined
def _fire(span: Any, y: int, x: int, t_us: int, positive: bool, events: Any) -> None:
    """One event, unless the pixel is still dead from its last one."""
    last_us = span.pixels.last_us
    if t_us - last_us[y, x] >= span.settings.refractory_us:
        last_us[y, x] = t_us
        if events.count[0] < len(events.t_us):
            events.t_us[events.count[0]] = t_us
            events.code[events.count[0]] = y << 17 | x << 1 | positive
        events.count[0] += 1
