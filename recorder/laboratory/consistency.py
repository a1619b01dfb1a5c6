"""Runs estimators over one drive with many seeds of noise, and compares covariances with scatter.

A figure of consistency: NEES over distance, true against stated deviation, and the scatter at the end.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import ConfigError, EvaluationError
from carlaloc_env.core.files.output_paths import check_output_file
from recorder.benchmark.run import BenchmarkConfig, Progress, run_benchmark
from recorder.dataset.sequence import RAW, SlamSequence
from recorder.evaluation.covariance_files import read_covariances
from recorder.evaluation.trajectory import Trajectory
from recorder.evaluation.trajectory_files import read_tum
from recorder.laboratory.pose_errors import (
    AXES,
    PoseErrors,
    Run,
    pose_errors,
)
from recorder.laboratory.pose_statistics import Consistency, consistency_of
from recorder.report.canvas import COLOURS, new_figure, save_figure
from recorder.slam.worker import ESTIMATE
from recorder.streaming.drive import DriveConfig

_PARTS = {"pose": slice(0, 6), "position": slice(0, 3), "rotation": slice(3, 6)}


@dataclass(frozen=True, slots=True, kw_only=True)
class ConsistencyConfig:
    """Configuration of a consistency test: estimators, drive and seeds."""

    drive: DriveConfig
    """One drive under one condition, with its number of noise seeds."""
    out: Path
    """Folder of the runs; those that lie there are not run again."""
    methods: tuple[str, ...] = ()
    """Names or files of systems; empty: those that are installed."""
    over_m: float = 10.0
    """Distance of the relative errors [m]."""
    workers: int = 1
    """Runs at a time, each on its own cores."""

    def __post_init__(self) -> None:
        options = self.drive.options
        if len(self.drive.episodes) != 1 or len(options.weathers) != 1 or len(options.traffic) != 1:
            raise ConfigError("scatter is that of one drive under one condition; give one of each")
        if self.drive.noise_seeds < 2:
            raise ConfigError("scatter needs two seeds or more; give --seeds 20")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MethodConsistency:
    """One estimator's errors over some seeds, and how its covariances compare with them."""

    title: str
    """Name of the estimator."""
    failed: int
    """Runs without an estimate, which are left out."""
    errors: tuple[PoseErrors, ...]
    """Errors since the start, and over a distance."""

    def compared(self, errors: PoseErrors, part: str) -> Consistency | None:
        """Stated covariances of ``pose``, ``position`` or ``rotation`` against errors; None: none stated."""
        rows = _PARTS[part]
        if errors.covariance is None:
            return None
        consistency = consistency_of(errors.error[..., rows], errors.covariance[..., rows, rows])
        return consistency if np.isfinite(consistency.anees).any() else None

    def rows(self) -> list[dict[str, Any]]:
        """A row of plain values for each kind of errors."""
        return [self._row(errors) for errors in self.errors]

    def _row(self, errors: PoseErrors) -> dict[str, Any]:
        spread, shared = scatter(errors)
        row: dict[str, Any] = {
            "method": self.title,
            "error": errors.kind,
            "runs": len(errors.error),
            "failed": self.failed,
            "poses": errors.error.shape[1],
            **{f"scatter_{axis}": float(value) for axis, value in zip(AXES, spread, strict=True)},
            **{f"shared_{axis}": float(value) for axis, value in zip(AXES, shared, strict=True)},
        }
        for part in _PARTS:
            consistency = self.compared(errors, part)
            if consistency is not None:
                row |= {f"{part}_{name}": value for name, value in _figures(consistency).items()}
        whole = self.compared(errors, "pose")
        if whole is not None:
            row |= {f"factor_{axis}": float(v) for axis, v in zip(AXES, whole.axis_scale, strict=True)}
        return row


def _figures(consistency: Consistency) -> dict[str, float]:
    figures = {"anees": float(np.nanmean(consistency.anees)), "within": consistency.within}
    intervals = {"factor": consistency.scale, "noise_factor": consistency.noise_scale}
    intervals |= {f"coverage_{100 * level:g}": interval for level, interval in consistency.coverage.items()}
    for name, interval in intervals.items():
        figures |= {name: interval.value, f"{name}_low": interval.low, f"{name}_high": interval.high}
    return figures


def scatter(errors: PoseErrors) -> tuple[Array, Array]:
    """Standard deviation about the mean of the runs, and RMS of that mean, by `AXES` [m, rad], (6,) each."""
    runs = len(errors.error)
    variance = errors.error.var(axis=0, ddof=1) if runs > 1 else np.full(errors.error.shape[1:], np.nan)
    return np.sqrt(variance.mean(axis=0)), np.sqrt(np.mean(errors.error.mean(axis=0) ** 2, axis=0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConsistencyResult:
    """Result of a consistency test: all estimators."""

    methods: tuple[MethodConsistency, ...]
    """One each."""
    failures: tuple[str, ...] = ()
    """A line for each run that failed."""

    def rows(self) -> list[dict[str, Any]]:
        """Rows of all methods."""
        return [row for method in self.methods for row in method.rows()]


def run_consistency(config: ConsistencyConfig, progress: Progress = lambda *_: None) -> ConsistencyResult:
    """Run every estimator with every seed of noise, and compare its covariances with its errors.

    Errors are given in the axes of `base_link`, so that "along" is the direction of driving for all.

    Raises:
        ConfigError: there is no such system.
        MissingDependencyError: a system that was asked for is not installed.
        EvaluationError: fewer than two runs of a system gave an estimate.
    """
    asked = BenchmarkConfig(
        data=config.drive, out=config.out, methods=config.methods, clouds=(RAW,), workers=config.workers
    )
    result = run_benchmark(asked, progress)
    methods = []
    for title in dict.fromkeys(job.title for job in result.jobs):
        jobs = [job for job in result.jobs if job.title == title]
        ended = [job for job, score in zip(result.jobs, result.scores, strict=True)
                 if job.title == title and score.coverage > 0]  # fmt: skip
        if len(ended) < 2:
            why = "; ".join(line for line in result.failures if line.startswith(title))
            raise EvaluationError(f"{len(ended)} of {len(jobs)} runs of {title} gave an estimate; {why}")
        runs = [read_run(config.out / job.folder / ESTIMATE, title) for job in ended]
        sequence = SlamSequence(ended[0].sequence.path, lidar=ended[0].sequence.lidar)
        frame = ended[0].system.frame
        truth, T_base_frame = read_tum(sequence.truth_file(frame)), sequence.T_base(frame)
        errors = pose_errors(truth, runs, over_m=config.over_m, T_base_frame=T_base_frame)
        methods.append(MethodConsistency(title=title, failed=len(jobs) - len(ended), errors=errors))
    return ConsistencyResult(methods=tuple(methods), failures=tuple(result.failures))


def compare_files(
    truth: Trajectory, estimates: Sequence[Path], *, over_m: float = 10.0, tied: bool = True
) -> ConsistencyResult:
    """Compare covariances that stand beside some estimates of one drive with their errors.

    Args:
        truth: True poses of the frame.
        estimates: TUM files, one a run, each with its ``.cov`` file.
        over_m: Distance of the relative errors [m].
        tied: Whether the first pose of each is laid on the true one.

    Raises:
        EvaluationError: a file cannot be read, or they have no poses in common with each other or the truth.
    """
    runs = [read_run(path, path.stem) for path in estimates]
    errors = pose_errors(truth, runs, over_m=over_m, tied=tied)
    title = estimates[0].stem if len(estimates) == 1 else f"{len(estimates)} estimates"
    return ConsistencyResult(methods=(MethodConsistency(title=title, failed=0, errors=errors),))


def read_run(path: Path, name: str) -> Run:
    """An estimate and the covariances beside it."""
    estimate = read_tum(path)
    return Run(estimate=replace(estimate, name=name), covariance=read_covariances(path, estimate))


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
    consistency = method.compared(errors, "pose")
    if consistency is None:
        axes.text(0.5, 0.5, "states no covariance", ha="center", transform=axes.transAxes, color="grey")
        axes.set(xticks=[], yticks=[])
        return
    way = errors.distance_m
    axes.plot(way, consistency.nees.T, color="grey", lw=0.4, alpha=0.4)
    axes.plot([], [], color="grey", lw=0.8, label="each run")
    axes.plot(way, consistency.anees, color=_TRUE, lw=1.8, label="mean of runs (ANEES)")
    axes.axhspan(*consistency.bounds, color=COLOURS[2], alpha=0.35, label="95 % of honest ANEES")
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
