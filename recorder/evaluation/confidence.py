"""Confidence intervals of means and of shares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import norm, t

CONFIDENCE = 0.95
"""Of all intervals."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """A figure and its bounds at `CONFIDENCE`."""

    value: float
    low: float
    high: float


def mean_interval(values: ArrayLike) -> Interval:
    """Mean of independent values with Student's bounds; NaN with fewer than two."""
    some = np.asarray(values, dtype=np.float64)
    mean, reach = float(np.mean(some)) if len(some) else float("nan"), float("nan")
    if len(some) > 1:
        quantile = t.ppf(0.5 + 0.5 * CONFIDENCE, len(some) - 1)
        reach = float(quantile * np.std(some, ddof=1) / np.sqrt(len(some)))
    return Interval(value=mean, low=mean - reach, high=mean + reach)


def wilson(share: float, trials: int) -> Interval:
    """Wilson's score interval of a share (JASA 22, 1927); the share need be no whole number of trials."""
    z = float(norm.ppf(0.5 + 0.5 * CONFIDENCE))
    centre = (share + z * z / (2 * trials)) / (1 + z * z / trials)
    reach = z / (1 + z * z / trials) * np.sqrt(share * (1 - share) / trials + (z / (2 * trials)) ** 2)
    # Rounding must not lead beyond 0 and 1.
    low, high = (float(np.clip(bound, 0.0, 1.0)) for bound in (centre - reach, centre + reach))
    return Interval(value=share, low=low, high=high)
