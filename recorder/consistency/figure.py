"""A figure of consistency: NEES over distance, true against stated deviation, and the scatter at the end."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.files.output_paths import check_output_file
from recorder.consistency.pairs import AXES, PoseErrors
from recorder.consistency.run import ConsistencyResult, MethodConsistency
from recorder.report.trajectory_plot import COLOURS, new_figure, save_figure

_LEVEL = 0.95
_TRUE, _STATED = COLOURS[0], COLOURS[1]


def plot_consistency(result: ConsistencyResult, path: Path, *, overwrite: bool = False) -> Path:
    """Draw a row for each method as a PNG.

    Args:
        result: What was compared.
        path: New image (.png).
        overwrite: Whether an older one is replaced.

    Raises:
        OutputError: the image exists, or its name is not that of an image.
        MissingDependencyError: matplotlib is not installed.
    """
    check_output_file(path, suffixes=(".png",), overwrite=overwrite)
    figure = new_figure(15.0, 4.4 * len(result.methods))
    table = figure.subplots(len(result.methods), 3, squeeze=False)
    for method, row in zip(result.methods, table, strict=True):
        errors = method.errors[0]
        _nees(row[0], method, errors)
        _deviations(row[1], errors)
        _end(row[2], errors)
    return save_figure(figure, path)


def _nees(axes: Any, method: MethodConsistency, errors: PoseErrors) -> None:
    axes.set(title=f"{method.title}: NEES of {len(errors.error)} runs", xlabel="distance [m]", ylabel="NEES")
    found = method.compared(errors, "pose")
    if found is None:
        axes.text(0.5, 0.5, "states no covariance", ha="center", transform=axes.transAxes, color="grey")
        axes.set(xticks=[], yticks=[])
        return
    way = errors.distance_m
    axes.plot(way, found.nees.T, color="grey", lw=0.4, alpha=0.4)
    axes.plot([], [], color="grey", lw=0.8, label="each run")
    axes.plot(way, found.anees, color=_TRUE, lw=1.8, label="mean of runs (ANEES)")
    axes.axhspan(*found.bounds, color=COLOURS[2], alpha=0.35, label="95 % of honest ANEES")
    axes.set_yscale("log")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="best")


def _deviations(axes: Any, errors: PoseErrors) -> None:
    runs = len(errors.error)
    for k, (axis, style) in enumerate(zip(AXES[:3], ("-", "--", ":"), strict=True)):
        if runs > 1:
            spread = errors.error[..., k].std(axis=0, ddof=1)
            axes.plot(errors.distance_m, 1000 * spread, style, color=_TRUE, lw=1.4, label=f"true, {axis}")
        if errors.covariance is not None:
            stated = np.sqrt(errors.covariance[..., k, k].mean(axis=0))
            axes.plot(errors.distance_m, 1000 * stated, style, color=_STATED, lw=1.4, label=f"stated, {axis}")
    title = "Deviation of the position between runs"
    axes.set(title=title, xlabel="distance [m]", ylabel="standard deviation [mm]")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, ncols=2)


def _end(axes: Any, errors: PoseErrors) -> None:
    last = 1000 * errors.error[:, -1, 1::-1]
    axes.plot(0, 0, "+", color="black", ms=12, label="truth")
    axes.plot(*last.T, "o", color=_TRUE, ms=4, label="end of each run")
    if len(last) > 2:
        _ellipse(axes, last.mean(axis=0), np.cov(last.T), _TRUE, "true scatter, 95 %")
    if errors.covariance is not None:
        stated = 1e6 * errors.covariance[:, -1, :2, :2].mean(axis=0)[::-1, ::-1]
        _ellipse(axes, last.mean(axis=0), stated, _STATED, "stated, 95 %")
    axes.invert_xaxis()
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(title="Error of the last pose", xlabel="across, left + [mm]", ylabel="along [mm]")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)


def _ellipse(axes: Any, centre: Array, covariance: Array, colour: str, label: str) -> None:
    values, vectors = np.linalg.eigh(covariance)
    turn = np.linspace(0.0, 2.0 * np.pi, 100)
    circle = np.sqrt(chi2.ppf(_LEVEL, 2)) * np.stack([np.cos(turn), np.sin(turn)])
    axes.plot(*(centre[:, None] + vectors @ (np.sqrt(np.maximum(values, 0))[:, None] * circle)), color=colour,
              lw=1.5, label=label)  # fmt: skip
