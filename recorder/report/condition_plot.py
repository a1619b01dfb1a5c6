"""Draws the effect of conditions on SLAM systems: estimated paths over the map, and errors over time."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from carlaloc_env.core.array_types import Array
from recorder.evaluation.path_errors import PathErrors
from recorder.report.canvas import COLOURS, new_figure, save_figure

MARGIN_M = 6.0
"""Room around all paths [m]."""
ROW_IN = 3.6
"""Height of a system's row [inches]."""


def plot_conditions(
    errors: Mapping[str, Mapping[str, PathErrors]], path: Path, lanes_m: Sequence[Array], title: str
) -> Path:
    """Draw a row for each system: the paths that it estimated under all conditions, and their errors."""
    figure = new_figure(15.0, 0.7 + ROW_IN * len(errors))
    figure.suptitle(title, fontsize=14)
    rows = figure.subplots(len(errors), 2, squeeze=False, width_ratios=(2, 1), sharey="col")
    for (over_map, over_time), (system, by_condition) in zip(rows, errors.items(), strict=True):
        draw_paths(over_map, by_condition, lanes_m)
        over_map.set_title(f"{system}: estimated paths, aligned as a whole")
        draw_errors(over_time, by_condition)
    return save_figure(figure, path)


def draw_paths(axes: Any, by_condition: Mapping[str, PathErrors], lanes_m: Sequence[Array]) -> None:
    """Draw the true path over the lanes, and those that were estimated under all conditions.

    The map is turned by 90° where the way leads north or south, so that the way lies across the picture.
    """
    truth_m = next(iter(by_condition.values())).truth_m[:, :2]
    paths_m = [errors.estimate_m[:, :2] for errors in by_condition.values()]
    east_m, north_m = np.ptp(truth_m, axis=0)
    turn = np.array([[0.0, -1.0], [1.0, 0.0]]) if north_m > east_m else np.eye(2)
    for lane in lanes_m:
        axes.plot(*(lane[:, :2] @ turn).T, color="0.8", lw=1.0, zorder=1)
    axes.plot(*(truth_m @ turn).T, color="black", lw=7, alpha=0.25, label="truth", zorder=2)
    for colour, (condition, errors), path_m in zip(COLOURS, by_condition.items(), paths_m, strict=False):
        rmse_m = np.sqrt(np.mean(errors.error_m**2))
        label = f"{condition}: {rmse_m:.2f} m"
        axes.plot(*(path_m @ turn).T, color=colour, lw=2.5, label=label, zorder=3)
    drawn_m = np.concatenate([truth_m, *paths_m]) @ turn
    (left, low), (right, high) = drawn_m.min(axis=0) - MARGIN_M, drawn_m.max(axis=0) + MARGIN_M
    axes.set(xlim=(left, right), ylim=(low, high), aspect="equal")
    names = ("north [m]", "west [m]") if north_m > east_m else ("east [m]", "north [m]")
    axes.set(xlabel=names[0], ylabel=names[1])
    axes.legend(loc="upper left", ncols=len(paths_m) + 1, framealpha=0.9, fontsize="small")


def draw_errors(axes: Any, by_condition: Mapping[str, PathErrors]) -> None:
    """Draw the errors of all conditions over time."""
    for colour, (condition, errors) in zip(COLOURS, by_condition.items(), strict=False):
        seconds = (errors.stamp_ns - errors.stamp_ns[0]) * 1e-9
        axes.plot(seconds, errors.error_m, color=colour, lw=1.8, label=condition)
    axes.set(xlabel="time [s]", ylabel="position error [m]", title="position error (RMSE at the paths)")
    axes.set_ylim(bottom=0)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
