"""Curves of a sweep: means and shares of failures with bands, and the areas under them."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from recorder.evaluation.confidence import mean_interval, wilson
from recorder.laboratory.sweep import Axis

FIGURES = ("ape_m", "rpe_m", "coverage")
"""Figures of a run that have a curve."""


def curves_of(runs: pd.DataFrame, axes: Sequence[Axis]) -> pd.DataFrame:
    """A row for each axis, series and value.

    Args:
        runs: Of `recorder.laboratory.sweep_run.SweepResult`.
        axes: Swept quantities.

    Returns:
        ``axis``, ``series`` (the system, with the values of other axes where all combinations were run),
        ``value``, ``runs``, ``failed``, ``fail_share`` with ``_low`` and ``_high``. Mean of each of `FIGURES`
        over the runs that did not fail, of the coverage over all, with ``_low`` and ``_high``.
    """
    rows: list[dict[str, Any]] = []
    for axis in axes:
        others = [other.name for other in axes if other.name != axis.name]
        here = runs[runs[axis.name].notna()]
        # The order of titles is that of the benchmark.
        for key, group in here.groupby(["title", *others, axis.name], sort=False, dropna=False):
            words = [f"{n}={v:g}" for n, v in zip(others, key[1:-1], strict=True) if not math.isnan(v)]
            good, count = group[group["failed"].isna()], len(group)
            failed = count - len(good)
            share = wilson(failed / count, count)
            row: dict[str, Any] = {
                "axis": axis.name, "series": " ".join([key[0], *words]), "value": key[-1],
                "runs": count, "failed": failed,
                "fail_share": share.value, "fail_share_low": share.low, "fail_share_high": share.high,
            }  # fmt: skip
            for name in FIGURES:
                some = np.asarray((group if name == "coverage" else good)[name], np.float64)
                mean = mean_interval(some[np.isfinite(some)])
                row |= {name: mean.value, f"{name}_low": mean.low, f"{name}_high": mean.high}
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
    finite = np.isfinite(y)
    x, y = x[finite], y[finite]
    if len(x) < 2:
        return float(y[0]) if len(x) else math.nan
    return float(np.sum(0.5 * (y[1:] + y[:-1]) * np.diff(x)) / (x[-1] - x[0]))
