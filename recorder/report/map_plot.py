"""Draws a map from above, coloured by its error, with the ghosts of movers in red."""

from pathlib import Path

import numpy as np

from carlaloc_env.core.array_types import Array, Mask
from carlaloc_env.core.files.output_paths import check_output_file
from recorder.report.canvas import new_figure, save_figure


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
    """Points relative to their mean, turned so that their largest spread lies along x."""
    away = xy_m - xy_m.mean(axis=0)
    axes = np.linalg.eigh(away.T @ away)[1][:, ::-1]
    axes[:, 1] *= np.sign(np.linalg.det(axes))  # a turn, no mirror
    turned: Array = away @ axes
    return turned
