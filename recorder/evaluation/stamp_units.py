"""Finds the unit of a file's stamps by its name, else by their size and steps."""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array

DECIMALS = {"s": 9, "ms": 6, "us": 3, "ns": 0}
"""Digits from a unit of time to nanoseconds."""
FRAMES_MAX = 10_000_000
"""Whole numbers below this may be numbers of frames, where a file may have them in place of times."""
_EPOCH_S = (3e8, 1e10)
"""Clocks that count from 1970 or 1980 show a time between these [s] (until the year 2286)."""
_STEP_S = (2e-5, 300.0)
"""Poses are not nearer or further apart in time than this [s]."""


def unit_of_stamps(stamps: Array, named: str | None = None) -> str:
    """Unit of stamps as they stand: ``s``, ``ms``, ``us`` or ``ns``.

    Args:
        stamps: The first of them, shape (N,).
        named: What the file's header calls it; it counts unless steps between poses are absurd in it.
    """
    stamps = stamps[np.isfinite(stamps)]
    steps = np.diff(stamps)
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    sensible = [u for u in DECIMALS if step == 0.0 or _STEP_S[0] <= _in_s(step, u) <= _STEP_S[1]]
    if named in sensible:
        return str(named)
    size = float(np.max(np.abs(stamps), initial=0.0))
    for unit in sensible:
        if _EPOCH_S[0] <= _in_s(size, unit) < _EPOCH_S[1]:
            return unit
    # A clock that counts from a start of its own shows its unit by its steps alone. Micro- and
    # nanoseconds are written without fractions.
    if np.all(stamps == np.round(stamps)):
        return next((unit for unit in DECIMALS if _in_s(step, unit) <= 2.0), "ns")
    return "ms" if 10.0 < step <= 2000.0 else "s"


def has_frame_numbers(stamp_ns: NDArray[np.int64]) -> bool:
    """Whether stamps [ns], read as seconds, look like numbers of frames: whole, and small."""
    return len(stamp_ns) > 1 and not np.any(stamp_ns % 10**9) and 0 <= stamp_ns[0] < FRAMES_MAX * 10**9


def _in_s(value: float, unit: str) -> float:
    return value * 10.0 ** (DECIMALS[unit] - 9)
