"""Draws how conditions compare, town by town: ratios of errors with the range that runs leave them."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from paper_findings import FINDINGS, kind_of

from recorder.benchmark.cells import cells, pairs_of
from recorder.benchmark.tables import titles_of

PANELS = (
    ("LiDAR: movers / none", ("LiDAR", "LiDAR-inertial"), ("dynamic / static",)),
    ("Stereo: movers / none", ("stereo",), ("dynamic / static",)),
    ("Stereo, all at rest: weather / clear", ("stereo",),
     ("FoggyNoon / ClearNoon (static)", "RainyNight / ClearNoon (static)")),
)  # fmt: skip
"""Title, kinds of systems and comparisons of each panel."""
_SIZE_IN, _DPI = (13.0, 4.2), 110


def draw_ratios(runs: pd.DataFrame, out: Path) -> None:
    """A panel for each question, a point for each town, system and weather; dashed, the paper's medians.

    Args:
        runs: Runs, see `recorder.benchmark.tables.frame_of`.
        out: PNG file.
    """
    pairs = pairs_of(cells(runs))
    pairs["kind"] = pairs["method"].map(kind_of)
    pairs["title"] = pairs["method"].map(titles_of(runs))
    figure = Figure(figsize=_SIZE_IN, dpi=_DPI, layout="constrained")
    for axes, (title, kinds, compared) in zip(
        figure.subplots(1, len(PANELS), sharey=True), PANELS, strict=True
    ):
        shown = pairs[pairs["kind"].isin(kinds) & pairs["what"].isin(compared)]
        _panel(axes, shown)
        for finding in FINDINGS:
            if finding.kind in kinds[:1] and finding.what in compared:
                axes.axhline(finding.median, ls="--", lw=1.0, color="0.45")
                weather = f", {finding.what.split()[0]}" if len(compared) > 1 else ""
                axes.annotate(
                    f"paper ×{finding.median:g}{weather}",
                    (0.5, finding.median),
                    (0, 3),
                    xycoords=("axes fraction", "data"),
                    textcoords="offset points",
                    ha="center",
                    fontsize=8,
                    color="0.3",
                )
        axes.set_title(title, fontsize=11)
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out)


def _panel(axes: Any, pairs: pd.DataFrame) -> None:
    towns = sorted(pairs["town"].unique())
    axes.set_yscale("log")
    axes.axhline(1.0, color="0.2", lw=1.0)
    axes.set_ylabel("ratio of APE")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.grid(axis="y", alpha=0.25)
    axes.tick_params(axis="x", rotation=45)
    groups = list(pairs.groupby(["title", "weather"], sort=False))
    several = pairs["weather"].nunique() > 1
    for number, ((title, weather), group) in enumerate(groups):
        low, high = group["low"] / group["high_base"], group["high"] / group["low_base"]
        spread = np.abs(np.array([group["ratio"] - low, high - group["ratio"]]))
        place = np.array([towns.index(town) for town in group["town"]]) + 0.12 * (number - len(groups) / 2)
        label = f"{title}, {weather}" if several else title
        axes.errorbar(place, group["ratio"], yerr=spread, fmt="o", ms=4, capsize=2, lw=1.0, label=label)
    axes.set_xticks(range(len(towns)), towns)
    if groups:
        # Below the panel: no point is hidden.
        axes.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)
