"""Draw docs/pictures/learning.jpg: how far the pupil of examples 11 and 13 came, ride by ride.

`python docs/scripts/make_learning_curve.py`, with the extra `report`.
`learning.csv` is what the examples told.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recorder.report.trajectory_plot import new_figure

PICTURES = Path(__file__).parents[1] / "pictures"
WINDOW = 15
"""Rides whose mean the line shows."""
TITLES = {"dagger": "the driver beside it (DAgger, example 11)", "ppo": "by reward alone (PPO, example 13)"}


def main() -> None:
    """Read and draw."""
    with (PICTURES / "learning.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    figure = new_figure(11.0, 3.6)
    axes = figure.subplots(1, len(TITLES), sharey=True)
    for axis, (stage, title) in zip(axes, TITLES.items(), strict=True):
        of_stage = [row for row in rows if row["stage"] == stage]
        done = 100.0 * np.array([float(row["route_completion"]) for row in of_stage])
        goal = np.array([row["ended_by"] == "goal" for row in of_stage])
        number = np.arange(1, len(done) + 1)
        axis.plot(number[goal], done[goal], ".", color="#3a7d44", label="goal reached")
        axis.plot(number[~goal], done[~goal], "x", color="#c0392b", markersize=4, label="ended before")
        axis.plot(number, _mean(done), color="#1f4e9c", label=f"mean of the last {WINDOW}")
        axis.set(xlabel="ride", title=title, ylim=(0, 104))
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("route completion [%]")
    axes[0].legend(loc="lower right", fontsize="small")
    figure.savefig(PICTURES / "learning.jpg", dpi=110, pil_kwargs={"quality": 88})


def _mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([values[max(0, k + 1 - WINDOW) : k + 1].mean() for k in range(len(values))])


if __name__ == "__main__":
    main()
