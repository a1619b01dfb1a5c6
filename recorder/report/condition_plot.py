"""Draws the effect of conditions on SLAM systems: position errors on the path, and over time."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from carlaloc_env.core.array_types import Array
from recorder.evaluation.path_errors import PathErrors
from recorder.report.canvas import COLOURS, new_figure, save_figure

MARGIN_M = 15.0


def plot_conditions(
    errors: Mapping[str, Mapping[str, PathErrors]], path: Path, lanes_m: Sequence[Array], title: str
) -> Path:
    """Draw a row for each system: its path under every condition, coloured by errors, and those over time."""
    columns = len(next(iter(errors.values()))) + 1
    figure = new_figure(5.0 * columns, 0.6 + 3.9 * len(errors))
    figure.suptitle(title, fontsize=14)
    rows = figure.subplots(len(errors), columns, squeeze=False)
    for row, (system, by_condition) in zip(rows, errors.items(), strict=True):
        worst_m = max(float(path_errors.error_m.max()) for path_errors in by_condition.values())
        for axes, (condition, path_errors) in zip(row, by_condition.items(), strict=False):
            shown = draw_way(axes, path_errors, lanes_m, worst_m)
            axes.set_title(f"{system}, {condition}: RMSE {np.sqrt(np.mean(path_errors.error_m**2)):.3f} m")
        figure.colorbar(shown, ax=row[-2], label="position error [m]", shrink=0.85)
        draw_errors(row[-1], by_condition)
    return save_figure(figure, path)


def draw_way(axes: Any, errors: PathErrors, lanes_m: Sequence[Array], worst_m: float) -> Any:
    """Draw the true path over the lanes, in the colours of the errors that were made there."""
    way = errors.truth_m[:, :2]
    for lane in lanes_m:
        axes.plot(lane[:, 0], lane[:, 1], color="0.8", lw=0.8, zorder=1)
    shown = axes.scatter(*way.T, c=errors.error_m, cmap="viridis", vmin=0.0, vmax=worst_m, s=9, zorder=2)
    axes.plot(*way[0], "o", color="black", ms=7, mfc="none", zorder=3)
    east, north = 0.5 * (way.max(axis=0) + way.min(axis=0))
    half = 0.5 * float(np.ptp(way, axis=0).max()) + MARGIN_M
    axes.set(xlim=(east - half, east + half), ylim=(north - half, north + half), aspect="equal")
    axes.set(xlabel="east [m]", ylabel="north [m]")
    return shown


def draw_errors(axes: Any, by_condition: Mapping[str, PathErrors]) -> None:
    """Draw the errors of all conditions over time."""
    for colour, (condition, errors) in zip(COLOURS, by_condition.items(), strict=False):
        seconds = (errors.stamp_ns - errors.stamp_ns[0]) * 1e-9
        axes.plot(seconds, errors.error_m, color=colour, lw=1.4, label=condition)
    axes.set(xlabel="time [s]", ylabel="position error [m]", title="after alignment by SE(3)")
    axes.set_ylim(bottom=0)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
