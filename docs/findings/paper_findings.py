"""Seven findings of the CARLA-Loc paper, each with one number, and a benchmark's verdict on them.

The numbers are medians over the paper's seven sequences (Tables II and IV, one run each) of A-LOAM, FAST-LIO2
and ORB-SLAM3, by the code that also compares our runs.
"""

from dataclasses import dataclass
from typing import Any

import pandas as pd

from recorder.benchmark.cells import CLEAR, cells, ratios
from recorder.slam.systems import SYSTEMS

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
    """Kind of its systems, see `kind_of`."""
    what: str
    """The comparison, as `ratios` names it."""
    median: float
    """Median ratio of the paper's system."""
    direction: str
    """`LARGER`, `SMALLER` or `NONE`, by the pairs of the paper's system."""


_AT_REST = {weather: f"{weather} / {CLEAR} (static)" for weather in ("FoggyNoon", "RainyNight")}
FINDINGS = (
    Finding("Movers hurt LiDAR odometry", "LiDAR", "dynamic / static", 1.58, LARGER),
    Finding("Movers do not hurt LiDAR-inertial odometry", "LiDAR-inertial", "dynamic / static", 0.96, NONE),
    Finding("Clouds without movers help LiDAR odometry", "LiDAR", "seg(d) / d", 0.65, SMALLER),
    Finding("Movers hurt stereo", "stereo", "dynamic / static", 7.23, LARGER),
    Finding("Movers do not hurt stereo-inertial odometry", "stereo-inertial", "dynamic / static", 1.45, NONE),
    Finding("Fog helps stereo, all at rest", "stereo", _AT_REST["FoggyNoon"], 0.10, SMALLER),
    Finding("Rain at night helps stereo, all at rest", "stereo", _AT_REST["RainyNight"], 0.21, SMALLER),
)


def kind_of(method: str) -> str:
    """Kind of a system by its input: LiDAR, LiDAR-inertial, stereo, stereo-inertial, or own."""
    if method not in SYSTEMS:
        return "own"
    system = SYSTEMS[method]
    # evalio wants the IMU of all of its pipelines, also of those that make no use of it.
    return ("stereo" if system.is_visual else "LiDAR") + ("-inertial" if "inertial" in system.what else "")


def direction(ratio: Any) -> str:
    """Direction on which most pairs of a row of `ratios` agree."""
    if max(ratio.larger, ratio.smaller) < SHARE * ratio.pairs:
        return NONE
    return LARGER if ratio.larger > ratio.smaller else SMALLER


def doubt(ratio: Any) -> str:
    """Why a row of `ratios` shows less than its direction; empty: it shows it beyond the spread of runs."""
    if ratio.pairs < PAIRS_MIN:
        return f"{ratio.pairs} pair{'s' * (ratio.pairs > 1)}: too few"
    if not ratio.repeated:
        return "seldom repeated"
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
