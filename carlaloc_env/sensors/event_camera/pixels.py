"""The pixels of an event camera, after ESIM (Rebecq et al., "ESIM: an Open Event Camera Simulator", 2018).

A pixel keeps the log intensity of its last event and fires when the signal has moved away from it
by a threshold. Between two pictures the signal is sampled along the true motion of what the pixel
sees, so often that nothing moves by more than a pixel from one sample to the next.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import rng
from carlaloc_env.core.array_types import F32
from carlaloc_env.core.jit import BAND_ROWS, compiled, over_bands
from carlaloc_env.sensors.event_camera.band_kernel import fire_rows
from carlaloc_env.sensors.event_camera.simd import float_of, word_of
from carlaloc_env.sensors.event_camera.threshold_crossings import NEVER_US
from carlaloc_env.sensors.event_camera.tile_motion import Scratch, new_scratch
from carlaloc_env.sensors.event_camera.time_sorting import Slots
from carlaloc_env.sensors.imaging.frame_motion import FrameMotion
from carlaloc_env.sensors.imaging.motion_field import TILE_PX
from carlaloc_env.sensors.imaging.motion_warping import tile_ranges


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
        order = np.argsort(pixel * (span_us + 1) + t_us)
        return cls(
            pixel=pixel[order].astype(np.int32),
            t_us=t_us[order].astype(np.int32),
            positive=generator.random(count) < 0.5,
        )


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


@compiled
def _luminance(rgb: Any, out: Any, first: int, end: int) -> None:
    r, g, b = np.float32(0.2126), np.float32(0.7152), np.float32(0.0722)
    for y in range(first, end):
        for x in range(rgb.shape[1]):
            out[y, x] = r * rgb[y, x, 0] + g * rgb[y, x, 1] + b * rgb[y, x, 2]


@compiled
def _log_blurred(image: Any, dark: Any, side: Any, out: Any, first: int, end: int) -> None:
    height, width = image.shape
    middle = np.float32(1) - np.float32(2) * side
    for y in range(first, end):
        up, down = max(y - 1, 0), min(y + 1, height - 1)
        for x in range(1, width - 1):
            a = side * (image[up, x - 1] + image[up, x + 1]) + middle * image[up, x]
            b = side * (image[y, x - 1] + image[y, x + 1]) + middle * image[y, x]
            c = side * (image[down, x - 1] + image[down, x + 1]) + middle * image[down, x]
            out[y, x] = log_of(side * (a + c) + middle * b + dark)
        for x in (0, width - 1):
            left, right = max(x - 1, 0), min(x + 1, width - 1)
            a = side * (image[up, left] + image[up, right]) + middle * image[up, x]
            b = side * (image[y, left] + image[y, right]) + middle * image[y, x]
            c = side * (image[down, left] + image[down, right]) + middle * image[down, x]
            out[y, x] = log_of(side * (a + c) + middle * b + dark)


@compiled
def log_of(value: Any) -> Any:
    """Natural logarithm by + − × ÷ alone, the same bits on every CPU; error below 1e-7.

    ln(m·2^e) = e·ln 2 + 2·atanh((m − 1)/(m + 1)) for m from √½ to √2. For a normal, positive float.
    """
    word = word_of(np.float32(value))
    m = np.float64(float_of(np.int32((word & np.int32(0x7FFFFF)) | np.int32(0x3F800000))))
    e = np.float64(np.int32(word >> np.int32(23)) - np.int32(127))
    high = m > 1.4142135623730951
    m, e = 0.5 * m if high else m, e + 1.0 if high else e
    q = (m - 1) / (m + 1)
    w = q * q
    series = 1 + w * (1 / 3 + w * (1 / 5 + w * (1 / 7 + w * (1 / 9 + w / 11))))
    return np.float32(e * 0.6931471805599453 + 2 * q * series)


def fire(
    before: F32,
    after: F32,
    motion: FrameMotion | None,
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
        `EVENT` rows by time, whole µs after the beginning; events of the same time tile by tile. And the
        state at the end.
    """
    height, width = before.shape
    if motion is None:
        motion = FrameMotion.none(before.shape)
    reference, last_us = np.empty_like(state.reference), np.empty_like(state.last_us)
    rows = (pixels.on, pixels.off, state.reference, state.last_us, reference, last_us)
    device = (*rows, *(row.reshape(-1) for row in (pixels.on, pixels.off, state.reference, reference)))
    order, first_shot = _by_tiles(shots.pixel, height, width)
    place = (shots.pixel // width << 16 | shots.pixel % width)[order]
    noise = (place, shots.t_us[order], shots.positive[order], first_shot)
    pictures = (before, after, tile_ranges(before), tile_ranges(after), before.reshape(-1), after.reshape(-1))
    flat = motion.forward.reshape(-1), motion.backward.reshape(-1)
    fields = (motion.forward, motion.backward, motion.passing, *flat)
    numbers = (span_us, refractory_us, np.float32(leak_hz * 1e-6 * span_us), np.float32(step_px))

    slots = Slots(-(-height // BAND_ROWS), span_us, 4 * before.size)
    desks: list[Desk] = []

    def band(first: int, end: int) -> None:
        # Not anew for every band: memory that has not been used before costs time.
        try:
            desk = desks.pop()
        except IndexError:
            desk = _new_desk(_ROOM * BAND_ROWS * width)
        scratch, t_us, code = desk
        while True:
            # Nor with what another band has left there.
            for notes in scratch:
                notes[...] = 0
            count = fire_rows(pictures, fields, device, noise, numbers, scratch, t_us, code, first, end)
            if count <= len(t_us):
                break
            scratch, t_us, code = desk = _new_desk(count)
        slots.take(first // BAND_ROWS, t_us[:count], code[:count])
        desks.append(desk)

    over_bands(band, height)
    events = slots.by_time(start_ns)
    return events, PixelState(reference=reference, last_us=last_us)


_ROOM = 16
"""Events per pixel that a band has room for: unused room takes no memory, too little makes it start anew."""
Desk = tuple[Scratch, NDArray[np.int32], NDArray[np.uint32]]


def _new_desk(room: int) -> Desk:
    """What a thread works on a band with: its notes, and room for times and codes of events."""
    return new_scratch(), np.empty(room, np.int32), np.empty(room, np.uint32)


def _by_tiles(
    pixel: NDArray[np.int32], height: int, width: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Order of pixels tile by tile, and where each row of tiles begins in it."""
    y, x = pixel.astype(np.int64) // width, pixel.astype(np.int64) % width
    rows, columns = -(-height // TILE_PX), -(-width // TILE_PX)
    tile = (y // TILE_PX) * columns + x // TILE_PX
    # One number for tile, place in it and order so far: sorted at once.
    key = (tile * TILE_PX**2 + y % TILE_PX * TILE_PX + x % TILE_PX) * len(pixel) + np.arange(len(pixel))
    key.sort()
    order = key % max(len(pixel), 1)
    first = np.searchsorted(tile[order], np.arange(rows + 1) * columns)
    return order, first.astype(np.int64)


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
