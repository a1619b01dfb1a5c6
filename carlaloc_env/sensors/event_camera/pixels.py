"""Pixels of an event camera: what they measure, and how their events leave the chip.

The pixels of an event camera: their thresholds, what they remember, and their noise.

What event pixels measure: the logarithm of the light that falls on them.

How events leave the chip: in the order of time, and no more of them than the read-out can pass on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import clock
from carlaloc_env.core.array_types import F32, I32, U32, Mask
from carlaloc_env.core.cores import over_bands
from carlaloc_env.core.jit import compiled
from carlaloc_env.samples import EVENT

NEVER_US = -(1 << 30)
"""Time of the last event of a pixel that has had none [µs]."""
THRESHOLD_MIN = np.float32(0.01)
"""Least threshold that scatter leaves to a pixel, no unit."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Thresholds:
    """Contrast thresholds, which differ between pixels and never change."""

    on: F32
    """Rise of log intensity that makes a positive event, shape (H, W)."""
    off: F32
    """Fall of log intensity that makes a negative event, shape (H, W)."""

    @classmethod
    def draw(
        cls, seed: int, name: str, shape: tuple[int, int], on: float, off: float, sigma: float
    ) -> Thresholds:
        """Normally scattered thresholds, none below `THRESHOLD_MIN`."""
        generator = clock.stream(seed, f"{name}/threshold")
        scatter = sigma * generator.standard_normal((2, *shape), dtype=np.float32)
        return cls(
            on=np.maximum(np.float32(on) + scatter[0], THRESHOLD_MIN),
            off=np.maximum(np.float32(off) + scatter[1], THRESHOLD_MIN),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PixelState:
    """What pixels remember."""

    reference: F32
    """Log intensity of the last event, less what has leaked since, shape (H, W)."""
    last_us: I32
    """Time of the last event, counted from the moment of the state [µs], shape (H, W)."""

    @classmethod
    def initial(
        cls, log_intensity: F32, thresholds: Thresholds, seed: int, name: str, stamp_ns: int
    ) -> PixelState:
        """State of a camera that has run for long: each reference anywhere within its thresholds."""
        lot = clock.stream(seed, f"{name}/begin", stamp_ns).random(log_intensity.shape, dtype=np.float32)
        reference = log_intensity + thresholds.off - lot * (thresholds.on + thresholds.off)
        return cls(reference=reference, last_us=np.full(log_intensity.shape, NEVER_US, np.int32))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NoiseEvents:
    """Events out of nothing, from photon and dark current noise, in the order of their pixels."""

    pixel: I32
    """Row-major index of the pixel, ascending, shape (N,)."""
    t_us: I32
    """Time from the beginning of the span [µs], ascending within a pixel, shape (N,)."""
    positive: Mask
    """Polarity, shape (N,)."""

    @classmethod
    def draw(
        cls, seed: int, name: str, stamp_ns: int, shape: tuple[int, int], rate_hz: float, span_us: int
    ) -> NoiseEvents:
        """Poisson noise of a rate per pixel [Hz]; `stamp_ns` keys the span."""
        generator = clock.stream(seed, f"{name}/shot", stamp_ns)
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


BLUR_SIDE = 0.1065
"""Weight of each neighbour in a blur of 0.5 px (standard deviation) over three pixels, no unit."""


def log_intensity(radiance_cd_m2: F32, dark_cd_m2: float, *, blurred: bool) -> F32:
    """Log of luminance plus dark current, in cd/m², shape (H, W).

    Args:
        radiance_cd_m2: Linear BT.709 colour [cd/m²], shape (H, W, 3).
        dark_cd_m2: Luminance whose photocurrent equals the dark current [cd/m²].
        blurred: Whether the lens' blur of 0.5 px is still missing from the picture.
    """
    shape = radiance_cd_m2.shape[:2]
    luminance, out = np.empty(shape, np.float32), np.empty(shape, np.float32)
    dark, side = np.float32(dark_cd_m2), np.float32(BLUR_SIDE if blurred else 0.0)
    over_bands(lambda first, end: _luminance(radiance_cd_m2, luminance, first, end), shape[0])

    def band(first: int, end: int) -> None:
        _blur(luminance, dark, side, out, first, end)
        _take_log(out.view(np.int32), out, first, end)

    over_bands(band, shape[0])
    return out


@compiled
def _luminance(rgb: Any, out: Any, first: int, end: int) -> None:
    r, g, b = np.float32(0.2126), np.float32(0.7152), np.float32(0.0722)
    for y in range(first, end):
        for x in range(rgb.shape[1]):
            out[y, x] = r * rgb[y, x, 0] + g * rgb[y, x, 1] + b * rgb[y, x, 2]


@compiled
def _blur(image: Any, dark: Any, side: Any, out: Any, first: int, end: int) -> None:
    """Blur across and down, and add the dark current."""
    height, width = image.shape
    middle = np.float32(1) - np.float32(2) * side
    for y in range(first, end):
        up, down = max(y - 1, 0), min(y + 1, height - 1)
        for x in range(width):
            left, right = max(x - 1, 0), min(x + 1, width - 1)
            a = side * (image[up, left] + image[up, right]) + middle * image[up, x]
            b = side * (image[y, left] + image[y, right]) + middle * image[y, x]
            c = side * (image[down, left] + image[down, right]) + middle * image[down, x]
            out[y, x] = side * (a + c) + middle * b + dark


@compiled
def _take_log(bits: Any, out: Any, first: int, end: int) -> None:
    for y in range(first, end):
        for x in range(out.shape[1]):
            out[y, x] = log_of(bits[y, x])


@compiled
def log_of(bits: Any) -> Any:
    """Natural logarithm by + − × ÷ alone, the same bits on every CPU; error below 1e-7.

    ln(m·2^e) = e·ln 2 + 2·atanh((m − 1)/(m + 1)) for m from √½ to √2.

    Args:
        bits: The 32 bits of a normal, positive float32, as an integer.
    """
    m = 1.0 + np.float64(np.int32(bits & np.int32(0x7FFFFF))) * 2.0**-23
    e = np.float64(np.int32(bits >> np.int32(23)) - np.int32(127))
    high = m > 1.4142135623730951
    m, e = 0.5 * m if high else m, e + 1.0 if high else e
    q = (m - 1) / (m + 1)
    w = q * q
    series = 1 + w * (1 / 3 + w * (1 / 5 + w * (1 / 7 + w * (1 / 9 + w / 11))))
    return np.float32(e * 0.6931471805599453 + 2 * q * series)


def by_time(t_us: list[I32], code: list[U32], start_ns: int, span_us: int) -> NDArray[np.void]:
    """Rows of `EVENT` by time; those of the same time stay in the order that they come in.

    Args:
        t_us: Times of the events of each band of rows [µs], from 0 to `span_us`.
        code: y · 2^17 + x · 2 + p of each of them.
        start_ns: What times count from [ns].
        span_us: Longest time [µs].
    """
    # Place of the first event of each microsecond; counting sort.
    counts = np.zeros(span_us + 2, np.int64)
    for times in t_us:
        _count(times, counts)
    places = np.cumsum(counts)
    events = np.empty(places[-1], EVENT)
    for times, codes in zip(t_us, code, strict=True):
        _put(times, codes, places, start_ns, events)
    return events


@compiled
def _count(t_us: Any, counts: Any) -> None:
    for t in t_us:
        counts[t + 1] += 1


@compiled
def _put(t_us: Any, code: Any, places: Any, start_ns: int, events: Any) -> None:
    for k in range(len(t_us)):
        t, event = t_us[k], code[k]
        row = places[t]
        places[t] += 1
        events[row].t = start_ns + 1000 * np.int64(t)
        events[row].x = event >> np.uint32(1) & np.uint32(0xFFFF)
        events[row].y = event >> np.uint32(17)
        events[row].p = event & np.uint32(1)


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
    # Of n events in a slot, those stay at which floor(rank · most / n) rises.
    kept = (total <= most) | ((rank + 1) * most // total > rank * most // total)
    result: NDArray[np.void] = events[kept]
    return result
