"""Pixels of an event camera: their thresholds, the state that they remember, and their noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from carlaloc_env.core import clock
from carlaloc_env.core.array_types import F32, I32, Mask

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
    """Memory of pixels."""

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
