"""Brings runs together: the median and range of those that did not fail, and how conditions compare."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from recorder.benchmark.plan import STATIC
from recorder.dataset.sequence import SEGMENTED

CONDITION = ["town", "weather", "traffic", "cloud"]
"""Columns of the condition that a row of a table stands for."""
CLEAR = "ClearNoon"
"""Weather that others are compared with."""
SMALL_M = 0.1
"""Error below which a growth says little, as that at which a run never counts as diverged [m]."""
CLEAR_GROWTH = 1.1
"""Least growth of an error that counts as a loss."""


def traffic_label(traffic: str, cloud: str) -> str:
    """The paper's letters: s, d, and seg(d) for clouds without movers."""
    short = {"static": "s", "dynamic": "d", "empty": "e"}.get(traffic, traffic)
    return f"seg({short})" if cloud == SEGMENTED else short


def figure(value: float) -> str:
    """A figure with the paper's two decimals, or three where it is small."""
    return f"{value:.3f}" if abs(value) < 1.0 else f"{value:.2f}"


def cells(runs: pd.DataFrame, column: str = "ape_m", by: Sequence[str] = ()) -> pd.DataFrame:
    """A row for each condition and system, runs and noise seeds of a condition together.

    Args:
        runs: Runs as in ``results.csv``.
        column: The figure to bring together.
        by: Columns that keep rows apart, too.

    Returns:
        Columns of the condition and ``method``; ``median``, ``low`` and ``high`` of the runs that did not
        fail, the median NaN if half of them did or nothing was measured, as drift on a path shorter than a
        segment; counts ``measured``, ``failed``, ``runs``; ``text``, all of it in words. Sorted as in the
        paper: by town and weather, static before seg(d) before dynamic.
    """
    good = runs["failed"].isna()
    value = runs[column].where(good & np.isfinite(runs[column]))
    cell = (
        runs.assign(value=value, lost=~good)
        .groupby([*CONDITION, "method", *by], sort=False)
        .agg(
            median=("value", "median"),
            low=("value", "min"),
            high=("value", "max"),
            measured=("value", "count"),
            failed=("lost", "sum"),
            runs=("lost", "size"),
        )
        .reset_index()
    )
    cell["median"] = cell["median"].where(cell["failed"] * 2 < cell["runs"])
    cell["text"] = [_text(row) for row in cell.itertuples()]
    place = np.where(cell["traffic"].isin(STATIC), 0, 2 - (cell["cloud"] == SEGMENTED))
    order = ["town", "weather", "place", "traffic"]
    return cell.assign(place=place).sort_values(order, kind="stable", ignore_index=True)


def _text(cell: Any) -> str:
    """Median, range of several runs, and how many failed."""
    if cell.failed * 2 >= cell.runs:
        return "fail"
    if not cell.measured:
        return "–"
    text = figure(cell.median)
    if cell.measured > 1:
        text += f" ({figure(cell.low)}–{figure(cell.high)})"
    return text + (f", {cell.failed} of {cell.runs} fail" if cell.failed else "")


def best(cell: pd.DataFrame) -> pd.Series:
    """Whether a cell's median, as printed, is the smallest of its condition's, if that has several."""
    printed = cell["median"].map(figure, na_action="ignore").astype(float)
    rows = printed.groupby([cell[name] for name in CONDITION])
    return (printed == rows.transform("min")) & (rows.transform("size") > 1)


def pairs_of(cell: pd.DataFrame) -> pd.DataFrame:
    """Pairs of conditions of a town that differ in one thing, both with a median.

    Args:
        cell: Of `cells`.

    Returns:
        A row a pair: columns of the condition, those of the one that it is compared with, ``…_base``, what is
        compared, ``what``, the ratio of medians, ``ratio``, and the flags that `ratios` counts.
    """
    pairs = _pairs(cell)
    return pairs[pairs["median"].notna()]


def losses_of(cell: pd.DataFrame, by: Sequence[str] = ()) -> pd.DataFrame:
    """What movers and weather cost each system, the largest loss first.

    Args:
        cell: Of `cells`.
        by: Columns that keep rows apart, as they were given to `cells`.

    Returns:
        As `pairs_of`, with ``growth``, the ratio once `SMALL_M` is added to both medians, infinite where half
        of the condition's runs failed, ``clear``, whether it is at least `CLEAR_GROWTH` and ranges of runs do
        not overlap, and ``row`` and ``row_base``, their rows in `cell`. Pairs that differ in their clouds are
        left out: labels are no condition.
    """
    pairs = _pairs(cell, by)
    growth = (pairs["median"] + SMALL_M) / (pairs["median_base"] + SMALL_M)
    pairs["growth"] = growth.where(pairs["failed"] * 2 < pairs["runs"], np.inf)
    pairs["clear"] = (pairs["growth"] >= CLEAR_GROWTH) & ~pairs["within"]
    pairs = pairs[pairs["growth"].notna() & (pairs["cloud"] == pairs["cloud_base"])]
    return pairs.sort_values("growth", ascending=False, kind="stable", ignore_index=True)


def _pairs(cell: pd.DataFrame, by: Sequence[str] = ()) -> pd.DataFrame:
    numbered = cell.reset_index(names="row")
    pairs = numbered.merge(numbered, on=["method", "town", *by], suffixes=("", "_base"))
    pairs["what"] = _compared(pairs)
    pairs = pairs[(pairs["median_base"] > 0) & (pairs["what"] != "")].copy()
    pairs["ratio"] = pairs["median"] / pairs["median_base"]
    pairs["repeated"] = (pairs["measured"] > 1) & (pairs["measured_base"] > 1)
    overlap = (pairs["low"] <= pairs["high_base"]) & (pairs["low_base"] <= pairs["high"])
    pairs["within"] = pairs["repeated"] & overlap
    pairs["larger"], pairs["smaller"] = pairs["ratio"] > 1, pairs["ratio"] < 1
    return pairs


def ratios(cell: pd.DataFrame) -> pd.DataFrame:
    """Ratios between conditions of a town: dynamic to static, seg(d) to dynamic, weathers to clear noon.

    Args:
        cell: Of `cells`.

    Returns:
        A row for each ``method`` and comparison, ``what``: ``median``, ``low`` and ``high`` of the ratios of
        medians; counts of ``pairs`` that have both conditions, of ratios above 1, ``larger``, and below,
        ``smaller``; of pairs with several runs on both sides, ``repeated``, since of others the spread is not
        known; and ``within``, of those the ones whose ranges overlap, so that they show no difference.
    """
    grouped = pairs_of(cell).groupby(["method", "what"])
    ratio = grouped["ratio"].agg(median="median", low="min", high="max", pairs="size")
    return ratio.join(grouped[["larger", "smaller", "repeated", "within"]].sum()).reset_index()


def _compared(pairs: pd.DataFrame) -> np.ndarray:
    """Name of the comparison of each pair; empty: its conditions differ in more than one thing."""
    weather, traffic, cloud = (pairs[name] == pairs[f"{name}_base"] for name in CONDITION[1:])
    movers = weather & cloud & ~traffic & pairs["traffic_base"].isin(STATIC)
    labels = weather & traffic & (pairs["cloud"] == SEGMENTED) & (pairs["cloud_base"] != SEGMENTED)
    air = traffic & cloud & ~weather & (pairs["weather_base"] == CLEAR)
    words = [
        pairs["traffic"] + " / " + pairs["traffic_base"],
        "seg(d) / d",
        pairs["weather"] + f" / {CLEAR} (" + pairs["traffic"] + ")",
    ]
    return np.select([movers, labels, air], words, "")
