"""An image of trajectories: seen from above, and their errors over time.

One picture of what conditions do to SLAM systems: errors over the map, and over time.

A picture of a map from above, coloured by its error, with the ghosts of movers in red.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from carlaloc_env.core.array_types import Array, Mask
from carlaloc_env.core.errors import EvaluationError, MissingDependencyError
from carlaloc_env.core.files.atomic_files import atomic_write
from carlaloc_env.core.files.output_paths import check_output_file
from recorder.evaluation.evaluation_result import EvaluationResult
from recorder.evaluation.metrics import Metric
from recorder.evaluation.path_errors import PathErrors

COLOURS = (
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00",
    "#56B4E9", "#8C564B", "#7F7F7F", "#B8A000", "#444444",
)  # fmt: skip
"""Okabe and Ito's colours, which colour-blind people can tell apart, and some more."""


def plot_trajectories(
    results: Sequence[EvaluationResult], path: str | Path, *, title: str = "", overwrite: bool = False
) -> Path:
    """Draw estimates over their truth from above, and the position error over time, as a PNG.

    Args:
        results: Results of one drive, each with the position error (`Metric.APE_TRANSLATION`).
        path: New image (.png).
        title: Line above the image.
        overwrite: Whether an older one is replaced.

    Raises:
        OutputError: the image exists, or its name is not that of an image.
        EvaluationError: there is nothing to draw, or the image cannot be written.
        MissingDependencyError: matplotlib is not installed.
    """
    check_output_file(path, suffixes=(".png",), overwrite=overwrite)
    if not results or any(Metric.APE_TRANSLATION not in result.values for result in results):
        raise EvaluationError("no position errors to draw; evaluate with Metric.APE_TRANSLATION")
    figure = new_figure(13.0, 6.0)
    above, over_time = figure.subplots(1, 2)
    longest = max(results, key=lambda result: result.matched).truth
    start_ns = min(int(result.truth.stamp_ns[0]) for result in results)
    above.plot(longest.position_m[:, 0], longest.position_m[:, 1], color="black", lw=2.5, label="truth")
    above.plot(*longest.position_m[0, :2], "o", color="black", ms=7)
    for k, result in enumerate(results):
        colour = COLOURS[k % len(COLOURS)]
        statistics = result.statistics[Metric.APE_TRANSLATION]
        xy = result.estimate.position_m
        label = f"{result.estimate.name}: RMSE {statistics.rmse:.3f} m, {result.coverage:.0%} of poses"
        above.plot(xy[:, 0], xy[:, 1], color=colour, lw=1.3, label=label)
        seconds = (result.truth.stamp_ns - start_ns) * 1e-9
        over_time.plot(seconds, result.values[Metric.APE_TRANSLATION], color=colour, lw=1.2)
    fits = ", ".join(dict.fromkeys(result.alignment.value for result in results))
    above.set(xlabel="east [m]", ylabel="north [m]", title=title or "Trajectories")
    above.set_aspect("equal", adjustable="datalim")
    above.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), frameon=False, fontsize=9)
    over_time.set(
        xlabel="time [s]", ylabel="|p_est − p_truth| [m]", title=f"Position error after alignment: {fits}"
    )
    over_time.set_ylim(bottom=0)
    for axes in (above, over_time):
        axes.grid(alpha=0.3)
    return save_figure(figure, Path(path))


def new_figure(width_in: float, height_in: float) -> Any:
    """An empty figure of matplotlib [inches].

    Raises:
        MissingDependencyError: matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingDependencyError(
            'plots need matplotlib; install it with: pip install "carlaloc-env[report]"'
        ) from error
    # Without pyplot, which keeps figures in a global list and may look for a display.
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Any, path: Path) -> Path:
    """Write a figure as a PNG, whole or not at all.

    Raises:
        EvaluationError: it cannot be written.
    """
    with atomic_write(path, EvaluationError) as part:
        figure.savefig(part, format="png", dpi=110)
    return path


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
        worst_m = max(float(found.error_m.max()) for found in by_condition.values())
        for axes, (condition, found) in zip(row, by_condition.items(), strict=False):
            shown = draw_way(axes, found, lanes_m, worst_m)
            axes.set_title(f"{system}, {condition}: RMSE {np.sqrt(np.mean(found.error_m**2)):.3f} m")
        figure.colorbar(shown, ax=row[-2], label="position error [m]", shrink=0.85)
        draw_errors(row[-1], by_condition)
    return save_figure(figure, path)


def draw_way(axes: Any, found: PathErrors, lanes_m: Sequence[Array], worst_m: float) -> Any:
    """Draw the true path over the lanes, in the colours of the errors that were made there."""
    way = found.truth_m[:, :2]
    for lane in lanes_m:
        axes.plot(lane[:, 0], lane[:, 1], color="0.8", lw=0.8, zorder=1)
    shown = axes.scatter(*way.T, c=found.error_m, cmap="viridis", vmin=0.0, vmax=worst_m, s=9, zorder=2)
    axes.plot(*way[0], "o", color="black", ms=7, mfc="none", zorder=3)
    east, north = 0.5 * (way.max(axis=0) + way.min(axis=0))
    half = 0.5 * float(np.ptp(way, axis=0).max()) + MARGIN_M
    axes.set(xlim=(east - half, east + half), ylim=(north - half, north + half), aspect="equal")
    axes.set(xlabel="east [m]", ylabel="north [m]")
    return shown


def draw_errors(axes: Any, by_condition: Mapping[str, PathErrors]) -> None:
    """Draw the errors of all conditions over time."""
    for colour, (condition, found) in zip(COLOURS, by_condition.items(), strict=False):
        seconds = (found.stamp_ns - found.stamp_ns[0]) * 1e-9
        axes.plot(seconds, found.error_m, color=colour, lw=1.4, label=condition)
    axes.set(xlabel="time [s]", ylabel="position error [m]", title="after alignment by SE(3)")
    axes.set_ylim(bottom=0)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)


def plot_map(
    points_m: Array,
    distance_m: Array,
    ghost: Mask,
    path: Path,
    *,
    title: str = "",
    error_max_m: float = 0.2,
    overwrite: bool = False,
) -> Path:
    """Draw a map as a PNG, its worst points on top.

    Args:
        points_m: Points of the map, world, shape (N, 3).
        distance_m: Their distances from the nearest surface [m], shape (N,).
        ghost: Which of them movers have left, shape (N,).
        path: New image (.png).
        title: Line above the image.
        error_max_m: Distance at the end of the colours [m].
        overwrite: Whether an older one is replaced.

    Raises:
        OutputError: the image exists, or its name is not that of an image.
        EvaluationError: it cannot be written.
        MissingDependencyError: matplotlib is not installed.
    """
    check_output_file(path, suffixes=(".png",), overwrite=overwrite)
    turned = _along(points_m[:, :2])
    wide, high = np.ptp(turned, axis=0)
    figure = new_figure(13.0, float(np.clip(10.8 * high / max(wide, 1e-9) + 1.0, 3.5, 12.0)))
    axes = figure.subplots()
    order = np.argsort(distance_m, kind="stable")
    order = order[~ghost[order]]
    drawn = axes.scatter(
        *turned[order].T, c=distance_m[order], s=0.3, lw=0, cmap="viridis", vmin=0.0, vmax=error_max_m,
        rasterized=True,
    )  # fmt: skip
    axes.scatter(*turned[ghost].T, color="red", s=1.5, lw=0, label=f"ghosts: {int(ghost.sum())} points")
    axes.set_aspect("equal")
    axes.set(xlabel="along the longest side [m]", ylabel="across [m]", title=title or "Map")
    if ghost.any():
        axes.legend(loc="upper right", markerscale=6)
    figure.colorbar(drawn, ax=axes, label="distance from the nearest surface [m]", shrink=0.8, extend="max")
    return save_figure(figure, path)


def _along(xy_m: Array) -> Array:
    """Places counted from their mean, the direction of their largest spread along x."""
    away = xy_m - xy_m.mean(axis=0)
    axes = np.linalg.eigh(away.T @ away)[1][:, ::-1]
    axes[:, 1] *= np.sign(np.linalg.det(axes))  # a turn, no mirror
    turned: Array = away @ axes
    return turned
