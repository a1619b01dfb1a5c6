"""Runs brought together: the median and range of what did not fail, and how conditions compare.

Does a benchmark show what the CARLA-Loc paper found? Seven of its findings, each with one number.

The paper's numbers are medians over its seven sequences (Tables II and IV, one run each), by the same code as
ours: of A-LOAM, FAST-LIO2 and ORB-SLAM3.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from recorder.benchmark.plan import STATIC
from recorder.dataset.sequence import SEGMENTED
from recorder.slam.systems import SYSTEMS

CONDITION = ["town", "weather", "traffic", "cloud"]
"""Columns of the condition that a row of a table stands for."""
CLEAR = "ClearNoon"
"""Weather that others are compared with."""


def traffic_label(traffic: str, cloud: str) -> str:
    """The paper's letters: s, d, and seg(d) for clouds without movers."""
    short = {"static": "s", "dynamic": "d", "empty": "e"}.get(traffic, traffic)
    return f"seg({short})" if cloud == SEGMENTED else short


def figure(value: float) -> str:
    """A figure with the paper's two decimals, or three where it is small."""
    return f"{value:.3f}" if abs(value) < 1.0 else f"{value:.2f}"


def cells(runs: pd.DataFrame, column: str = "ape_m") -> pd.DataFrame:
    """A row for each condition and system, runs and noise seeds of a condition together.

    Args:
        runs: Runs as in ``results.csv``.
        column: The figure to bring together.

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
        .groupby([*CONDITION, "method"], sort=False)
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
    """Pairs of conditions of a town that differ in one thing.

    Args:
        cell: Of `cells`.

    Returns:
        A row a pair: columns of the condition, those of the one that it is compared with, ``…_base``, what is
        compared, ``what``, the ratio of medians, ``ratio``, and the flags that `ratios` counts.
    """
    pairs = cell.merge(cell, on=["method", "town"], suffixes=("", "_base"))
    pairs["what"] = _compared(pairs)
    pairs["ratio"] = pairs["median"] / pairs["median_base"]
    known = pairs["median"].notna() & (pairs["median_base"] > 0)
    pairs = pairs[known & (pairs["what"] != "")].copy()
    pairs["repeated"] = (pairs["measured"] > 1) & (pairs["measured_base"] > 1)
    overlap = (pairs["low"] <= pairs["high_base"]) & (pairs["low_base"] <= pairs["high"])
    pairs["within"] = pairs["repeated"] & overlap
    pairs["larger"], pairs["smaller"] = pairs["ratio"] > 1, pairs["ratio"] < 1
    return pairs


def ratios(cell: pd.DataFrame) -> pd.DataFrame:
    """How conditions of a town compare: dynamic to static, seg(d) to dynamic, weathers to clear noon.

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
    """What each pair of cells compares; empty: they differ in more than one thing."""
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


PAIRS_MIN, SHARE = 3, 2 / 3
"""Fewest pairs that count, and the share of them that must agree."""
NO_SYSTEM = "–"
"""Stands for a system where none of the kind ran."""
LARGER, SMALLER, NONE = "larger", "smaller", "no direction"


@dataclass(frozen=True, slots=True)
class Finding:
    """One finding of the paper."""

    text: str
    """The finding in words."""
    kind: str
    """Kind of systems that it speaks of, see `kind_of`."""
    what: str
    """The comparison, as `ratios` names it."""
    median: float
    """Median ratio of the paper's system."""
    direction: str
    """`LARGER`, `SMALLER` or `NONE`, by the pairs of the paper's system."""


_AT_REST = {weather: f"{weather} / {CLEAR} (static)" for weather in ("FoggyNoon", "RainyNight")}
FINDINGS = (
    Finding("Movers hurt LiDAR odometry", "LiDAR", "dynamic / static", 1.58, LARGER),
    Finding("Inertia spares LiDAR from movers", "LiDAR-inertial", "dynamic / static", 0.96, NONE),
    Finding("Labels give LiDAR back what movers cost", "LiDAR", "seg(d) / d", 0.65, SMALLER),
    Finding("Movers hurt stereo", "stereo", "dynamic / static", 7.23, LARGER),
    Finding("Inertia spares stereo from movers", "stereo-inertial", "dynamic / static", 1.45, NONE),
    Finding("Fog helps stereo, all at rest", "stereo", _AT_REST["FoggyNoon"], 0.10, SMALLER),
    Finding("Rain at night helps stereo, all at rest", "stereo", _AT_REST["RainyNight"], 0.21, SMALLER),
)


def kind_of(method: str) -> str:
    """What a system reads: LiDAR, LiDAR-inertial, stereo, stereo-inertial; one's own are of no kind."""
    if method not in SYSTEMS:
        return "own"
    system = SYSTEMS[method]
    # evalio wants the IMU of all of its pipelines, also of those that make no use of it.
    return ("stereo" if system.is_visual else "LiDAR") + ("-inertial" if "inertial" in system.what else "")


def direction(ratio: Any) -> str:
    """What most pairs of a row of `ratios` agree on."""
    if max(ratio.larger, ratio.smaller) < SHARE * ratio.pairs:
        return NONE
    return LARGER if ratio.larger > ratio.smaller else SMALLER


def doubt(ratio: Any) -> str:
    """Why a row of `ratios` shows less than its direction; empty: it shows it beyond the spread of runs."""
    if ratio.pairs < PAIRS_MIN:
        return f"{ratio.pairs} pair{'s' * (ratio.pairs > 1)}: too few"
    if not ratio.repeated:
        return "spread of runs not known"
    if ratio.repeated < SHARE * ratio.pairs:
        return f"spread of runs known in {ratio.repeated} of {ratio.pairs} pairs alone"
    if ratio.within > (1 - SHARE) * ratio.repeated:
        return f"rests on less than the spread of runs ({ratio.within} of {ratio.repeated})"
    return ""


def answer(finding: Finding, ratio: Any) -> str:
    """Reproduced, partly (with a doubt), not, or untested; no loss is reproduced while none is seen."""
    if ratio.pairs < PAIRS_MIN:
        return "untested"
    found, doubted = direction(ratio), bool(doubt(ratio))
    if finding.direction == NONE:
        return "reproduced" if found != LARGER else "partly" if doubted else "not"
    if found != finding.direction:
        return "not"
    return "partly" if doubted else "reproduced"


def answers_table(runs: pd.DataFrame) -> pd.DataFrame:
    """A row for each finding and system of its kind, as words; untested ones without a system have one, too.

    Args:
        runs: Runs, see `tables.frame_of`.
    """
    ratio = ratios(cells(runs))
    titles = runs.drop_duplicates("method").set_index("method")["title"]
    rows = []
    for finding in FINDINGS:
        known = [row for row in ratio[ratio["what"] == finding.what].itertuples()
                 if kind_of(str(row.method)) == finding.kind]  # fmt: skip
        shown = [
            (titles[row.method], f"×{row.median:.2f}", answer(finding, row), doubt(row)) for row in known
        ]
        for system, median, verdict, why in shown or [(NO_SYSTEM, "", "untested", "no system ran")]:
            rows.append((finding.text, f"×{finding.median:.2f}", system, median, verdict, why))
    return pd.DataFrame(
        rows, columns=["the paper's finding", "paper", "system here", "here", "verdict", "doubt"]
    )
