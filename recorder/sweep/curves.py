"""Curves of a sweep: means with bands, shares of failures with bands, and the areas under them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import norm, t

from recorder.sweep.setting import Axis

CONFIDENCE = 0.95
FIGURES = ("ape_m", "rpe_m", "coverage")
"""Figures of a run that have a curve."""


def mean_interval(values: Sequence[float]) -> tuple[float, float, float]:
    """Mean of a sample, and Student's interval of it; the interval is NaN for less than two values."""
    some = np.asarray([value for value in values if math.isfinite(value)], np.float64)
    if len(some) == 0:
        return math.nan, math.nan, math.nan
    mean = float(some.mean())
    if len(some) == 1:
        return mean, math.nan, math.nan
    half = float(t.ppf(0.5 + CONFIDENCE / 2, len(some) - 1) * some.std(ddof=1) / math.sqrt(len(some)))
    return mean, mean - half, mean + half


def wilson_interval(failed: int, runs: int) -> tuple[float, float]:
    """Interval of a probability of which so many of so many were seen (Wilson, JASA 1927)."""
    z, share = float(norm.ppf(0.5 + CONFIDENCE / 2)), failed / runs
    middle = (share + z * z / (2 * runs)) / (1 + z * z / runs)
    half = z / (1 + z * z / runs) * math.sqrt(share * (1 - share) / runs + z * z / (4 * runs * runs))
    return max(middle - half, 0.0), min(middle + half, 1.0)


def curves_of(runs: pd.DataFrame, axes: Sequence[Axis]) -> pd.DataFrame:
    """A row for each axis, series and value.

    Args:
        runs: Of `recorder.sweep.run.SweepResult`.
        axes: What was swept.

    Returns:
        ``axis``, ``series`` (the system, with the values of other axes where all combinations were run),
        ``value``, ``runs``, ``failed``, ``fail_share`` with ``_low`` and ``_high``; mean of each of `FIGURES`
        over the runs that did not fail, of the coverage over all, with ``_low`` and ``_high``.
    """
    rows: list[dict[str, Any]] = []
    for axis in axes:
        others = [one.name for one in axes if one.name != axis.name]
        here = runs[runs[axis.name].notna()]
        # The order of titles is that of the benchmark.
        for key, group in here.groupby(["title", *others, axis.name], sort=False, dropna=False):
            words = [f"{n}={v:g}" for n, v in zip(others, key[1:-1], strict=True) if not math.isnan(v)]
            good, count = group[group["failed"].isna()], len(group)
            failed = count - len(good)
            low, high = wilson_interval(failed, count)
            row: dict[str, Any] = {
                "axis": axis.name, "series": " ".join([key[0], *words]), "value": key[-1],
                "runs": count, "failed": failed,
                "fail_share": failed / count, "fail_share_low": low, "fail_share_high": high,
            }  # fmt: skip
            for name in FIGURES:
                some = group if name == "coverage" else good
                row[name], row[f"{name}_low"], row[f"{name}_high"] = mean_interval(some[name].tolist())
            rows.append(row)
    return pd.DataFrame(rows)


def areas_of(curves: pd.DataFrame, axes: Sequence[Axis]) -> pd.DataFrame:
    """Scores of each series over each axis: areas under its curves by the length of the axis.

    ``success`` is that under the share of runs that do not fail, 0–1; ``ape_m`` and ``rpe_m`` are those under
    the mean errors, over the values where some run did not fail. Logarithmic axes are measured by their
    logarithm.
    """
    rows = []
    for axis in axes:
        here = curves[curves["axis"] == axis.name]
        for series, curve in here.groupby("series", sort=False):
            x = np.asarray(curve["value"], np.float64)
            x = np.log(x) if axis.is_log else x
            area = {"success": _area(x, 1.0 - np.asarray(curve["fail_share"], np.float64))}
            area |= {name: _area(x, np.asarray(curve[name], np.float64)) for name in FIGURES[:2]}
            rows.append({"axis": axis.name, "series": series, **area})
    return pd.DataFrame(rows)


def _area(x: np.ndarray, y: np.ndarray) -> float:
    """Mean of a curve of straight lines over its abscissae."""
    known = np.isfinite(y)
    x, y = x[known], y[known]
    if len(x) < 2:
        return float(y[0]) if len(x) else math.nan
    return float(np.sum(0.5 * (y[1:] + y[:-1]) * np.diff(x)) / (x[-1] - x[0]))
