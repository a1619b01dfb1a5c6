"""Draw docs/pictures/learning.jpg: how the agents of example 19 learn, ride by ride.

`python docs/scripts/make_learning_curve.py`, with the extra `report`.
`learning.csv` holds the rides of all `rides_*.monitor.csv`, in the order of their ends.
"""

import csv
from pathlib import Path

import numpy as np

from recorder.report.canvas import new_figure

PICTURES = Path(__file__).parents[1] / "pictures"
WINDOW = 40
"""Rides whose mean a line shows."""
PANELS = {
    "the state vector": {
        "state, seed 0": "#1f4e9c",
        "state, seed 1": "#3a7d44",
        "state, seed 2": "#b8860b",
    },
    "the picture from above, and none": {"bev": "#1f4e9c", "nothing": "#c0392b"},
}

TOP = dict(zip(PANELS, (400, 200), strict=True))
"""Greatest rewards that the panels show."""


def main() -> None:
    """Read and draw."""
    with (PICTURES / "learning.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    figure = new_figure(11.0, 3.6)
    axes = figure.subplots(1, len(PANELS))
    for axis, (title, runs) in zip(axes, PANELS.items(), strict=True):
        for run, colour in runs.items():
            rides = [row for row in rows if row["run"] == run]
            actions = np.cumsum([int(row["actions"]) for row in rides]) / 1000.0
            earned = np.array([float(row["reward"]) for row in rides])
            mean = [earned[max(0, k + 1 - WINDOW) : k + 1].mean() for k in range(len(earned))]
            axis.plot(actions, earned, ".", color=colour, alpha=0.15, markersize=3)
            axis.plot(actions, mean, color=colour, label=run)
        axis.set(xlabel="actions [thousands]", title=f"PPO from nothing: {title}", ylim=(-60, TOP[title]))
        axis.grid(alpha=0.3)
        axis.legend(loc="upper left", fontsize="small")
    axes[0].set_ylabel(f"reward of a ride of 100 s (mean of {WINDOW})")
    figure.savefig(PICTURES / "learning.jpg", dpi=110, pil_kwargs={"quality": 88})


if __name__ == "__main__":
    main()
