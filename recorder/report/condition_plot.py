"""One picture of what conditions do to SLAM systems: errors over the map, and over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.files.output_paths import check_output_file
from recorder.evaluation.evaluate import EvaluationResult
from recorder.evaluation.metrics import Metric
from recorder.report.trajectory_plot import new_figure, save_figure

_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")
"""Okabe and Ito's colours, which colour-blind people can tell apart, a condition each."""
_MARGIN_M = 15.0


def plot_conditions(
    results: Mapping[str, Mapping[str, EvaluationResult]],
    path: str | Path,
    *,
    lanes_m: Sequence[Array] = (),
    title: str = "",
    overwrite: bool = False,
) -> Path:
    """Draw a row for each system: its way under every condition, coloured by its error, and errors over time.

    Args:
        results: Results by system, then by condition; all systems have the same conditions.
        path: New image (.png).
        lanes_m: Centre lines of lanes [m], shape (K, 2) or (K, 3) each.
        title: Line above the image.
        overwrite: Whether an older one is replaced.

    Raises:
        OutputError: the image exists, or its name says that it is none.
        EvaluationError: there is nothing to draw, or the image cannot be written.
        MissingDependencyError: matplotlib is not installed.
    """
    check_output_file(path, suffixes=(".png",), overwrite=overwrite)
    conditions = list(next(iter(results.values()), {}))
    if not conditions or any(list(row) != conditions for row in results.values()):
        raise EvaluationError("no results to draw; give each system the same conditions")
    columns = len(conditions) + 1
    figure = new_figure(5.0 * columns, 0.6 + 3.9 * len(results))
    axes = figure.subplots(len(results), columns, squeeze=False)
    figure.suptitle(title, fontsize=14)
    for row, (system, by_condition) in zip(axes, results.items(), strict=True):
        worst_m = max(float(_errors(result).max()) for result in by_condition.values())
        for k, (cell, (condition, result)) in enumerate(zip(row, by_condition.items(), strict=False)):
            rmse_m = result.statistics[Metric.APE_TRANSLATION].rmse
            shown = _draw_way(cell, result, lanes_m, worst_m)
            cell.set_title(f"{system}, {condition}: RMSE {rmse_m:.3f} m")
            if k == len(conditions) - 1:
                figure.colorbar(shown, ax=cell, label="position error [m]", shrink=0.85)
        _draw_errors(row[-1], by_condition)
    return save_figure(figure, Path(path))


def _errors(result: EvaluationResult) -> Array:
    errors: Array = result.values[Metric.APE_TRANSLATION]
    return errors


def _draw_way(axes: Any, result: EvaluationResult, lanes_m: Sequence[Array], worst_m: float) -> Any:
    """The true way over the lanes, in the colours of the errors that were made there."""
    way = result.truth.position_m[:, :2]
    for lane in lanes_m:
        axes.plot(lane[:, 0], lane[:, 1], color="0.8", lw=0.8, zorder=1)
    shown = axes.scatter(
        way[:, 0], way[:, 1], c=_errors(result), cmap="viridis", vmin=0.0, vmax=worst_m, s=9, zorder=2
    )
    axes.plot(*way[0], "o", color="black", ms=7, mfc="none", zorder=3)
    middle, half = (
        0.5 * (way.max(axis=0) + way.min(axis=0)),
        0.5 * float(np.ptp(way, axis=0).max()) + _MARGIN_M,
    )
    axes.set(
        xlim=(middle[0] - half, middle[0] + half),
        ylim=(middle[1] - half, middle[1] + half),
        xlabel="east [m]",
        ylabel="north [m]",
    )
    axes.set_aspect("equal")
    return shown


def _draw_errors(axes: Any, by_condition: Mapping[str, EvaluationResult]) -> None:
    start_ns = min(int(result.truth.stamp_ns[0]) for result in by_condition.values())
    for k, (condition, result) in enumerate(by_condition.items()):
        seconds = (result.truth.stamp_ns - start_ns) * 1e-9
        axes.plot(seconds, _errors(result), color=_COLOURS[k % len(_COLOURS)], lw=1.4, label=condition)
    axes.set(xlabel="time [s]", ylabel="position error [m]", title="after alignment by SE(3)")
    axes.set_ylim(bottom=0)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
