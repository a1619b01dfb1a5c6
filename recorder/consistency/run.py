"""Runs estimators over one drive with many seeds of noise, and compares covariances with scatter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import ConfigError, EvaluationError
from recorder.benchmark.plan import Job
from recorder.benchmark.run import BenchmarkConfig, Progress, run_benchmark
from recorder.consistency.pairs import AXES, PoseErrors, Run, pose_errors
from recorder.consistency.statistics import Consistency, consistency_of
from recorder.dataset.sequence import RAW, SlamSequence
from recorder.evaluation.trajectory import Trajectory, read_covariances
from recorder.evaluation.trajectory_files import read_tum
from recorder.slam.worker import ESTIMATE
from recorder.streaming.drive import DriveConfig

_PARTS = {"pose": slice(0, 6), "position": slice(0, 3), "rotation": slice(3, 6)}


@dataclass(frozen=True, slots=True, kw_only=True)
class ConsistencyConfig:
    """Which estimators run over which drive."""

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
        found = consistency_of(errors.error[..., rows], errors.covariance[..., rows, rows])
        return found if np.isfinite(found.anees).any() else None

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
            found = self.compared(errors, part)
            if found is not None:
                row |= {f"{part}_{name}": value for name, value in _figures(found).items()}
        whole = self.compared(errors, "pose")
        if whole is not None:
            row |= {f"factor_{axis}": float(v) for axis, v in zip(AXES, whole.axis_scale, strict=True)}
        return row


def _figures(found: Consistency) -> dict[str, float]:
    figures = {"anees": float(np.nanmean(found.anees)), "within": found.within}
    intervals = {"factor": found.scale, "noise_factor": found.noise_scale}
    intervals |= {f"coverage_{100 * level:g}": interval for level, interval in found.coverage.items()}
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
    """All estimators that were compared."""

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
    found = []
    for title in dict.fromkeys(job.title for job in result.jobs):
        jobs = [job for job in result.jobs if job.title == title]
        ended = [job for job, score in zip(result.jobs, result.scores, strict=True)
                 if job.title == title and score.coverage > 0]  # fmt: skip
        if len(ended) < 2:
            why = "; ".join(line for line in result.failures if line.startswith(title))
            raise EvaluationError(f"{len(ended)} of {len(jobs)} runs of {title} gave an estimate; {why}")
        runs = [read_run(config.out / job.folder / ESTIMATE, title) for job in ended]
        truth, T_base_frame = _truth_of(ended[0])
        errors = pose_errors(truth, runs, over_m=config.over_m, T_base_frame=T_base_frame)
        found.append(MethodConsistency(title=title, failed=len(jobs) - len(ended), errors=errors))
    return ConsistencyResult(methods=tuple(found), failures=tuple(result.failures))


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


def _truth_of(job: Job) -> tuple[Trajectory, Array]:
    """Truth of a system's frame, and what maps that frame to `base_link`."""
    sequence, frame = SlamSequence(job.sequence.path), job.system.frame
    T = np.eye(4)
    if frame in ("lidar", "imu"):
        T = (sequence.lidar if frame == "lidar" else sequence.imu).mount.T_base_sensor
    elif frame == "camera":
        T = sequence.stereo[0].mount.T_base_sensor
    return read_tum(sequence.truth_file(frame)), T
