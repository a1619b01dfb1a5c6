"""Scores a run: errors of its estimate, its cost, and whether it counts as failed."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from carlaloc_env.core.errors import CarlaLocError, EvaluationError
from recorder.benchmark.plan import Job
from recorder.dataset.sequence import SlamSequence
from recorder.evaluation.align import attitude_errors_deg
from recorder.evaluation.associate import Association
from recorder.evaluation.evaluate import evaluate
from recorder.evaluation.fail_rule import FailRule
from recorder.evaluation.metrics import Metric, Statistics
from recorder.evaluation.path_errors import PathErrors
from recorder.evaluation.trajectory import Trajectory
from recorder.evaluation.trajectory_files import read_tum
from recorder.slam.supervisor import RunRecord
from recorder.slam.worker import ESTIMATE

ERRORS = "errors.npz"
"""File with the errors of all poses of a run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """Metrics of one run; NaN where there is none."""

    dataset: str
    town: str
    weather: str
    traffic: str
    cloud: str
    method: str
    title: str
    run: int
    version: str
    failed: str | None
    """Why it counts as failed; None: it does not."""
    ape_m: float = float("nan")
    """Position error, RMSE [m]."""
    ape_deg: float = float("nan")
    """Rotation error as evo has it, behind a fit of positions, RMSE [deg]."""
    attitude_deg: float = float("nan")
    """Rotation error behind a fit of the attitudes themselves, RMSE [deg]."""
    rpe_paper_m: float = float("nan")
    """The paper's relative error, RMSE [m]."""
    rpe_m: float = float("nan")
    """evo's relative error, RMSE [m]."""
    kitti_percent: float = float("nan")
    """Mean drift over KITTI's segments [%]."""
    kitti_deg_per_m: float = float("nan")
    """Mean turn over KITTI's segments [deg/m]."""
    coverage: float = 0.0
    """Share of the frames that have a pose, 0–1."""
    time_coverage: float = float("nan")
    """Share of the time that has poses, 0–1."""
    findings: str = ""
    """Causes of errors that lie in the data or the estimate, see `EvaluationResult.findings`."""
    alignment: str = ""
    """Fit of the estimate to the truth."""
    visual: bool = False
    """Whether it reads images."""
    frame: str = ""
    """Frame whose truth it was compared with."""
    instant: float = 0.0
    """Instant within a sweep that its poses belong to, 0–1."""
    length_m: float = float("nan")
    """Length of the true path [m]."""
    movers: float = 0.0
    """Largest share of movers of the sequence's streams, 0–1."""
    real_time: float = float("nan")
    """Median time of a frame by the time between frames; below 1 keeps up."""
    frame_median_s: float = float("nan")
    frame_p99_s: float = float("nan")
    wall_s: float = float("nan")
    cpu_s: float = float("nan")
    peak_memory_mb: float = float("nan")
    cores: int = 0
    lidar: str = ""
    """Name of the LiDAR that it reads; empty: none."""


def score_run(job: Job, folder: Path, record: RunRecord, rule: FailRule) -> Score:
    """The score of a run that has ended, however it did; its errors are kept beside its estimate.

    Errors are against the truth of the system's own frame, interpolated to the stamps of its poses.
    """
    sequence, system = SlamSequence(job.sequence.path, lidar=job.sequence.lidar), job.system
    costs = ("version", "wall_s", "cpu_s", "peak_memory_mb", "cores", "frame_median_s", "frame_p99_s")
    facts: dict[str, Any] = {
        **{name: getattr(job.sequence, name) for name in ("dataset", "town", "weather", "traffic", "movers")},
        **{name: getattr(record, name) for name in costs},
        "cloud": job.cloud,
        "method": system.name,
        "title": system.title,
        "run": job.run,
        "visual": system.is_visual,
        "frame": system.frame,
        "instant": system.instant,
        "alignment": system.alignment.value,
        "findings": job.sequence.findings,
    }
    if system.sensor == "lidar" and (lidars := sequence.rig.of_kind("lidar")):
        facts["lidar"] = lidars[0].name
    if record.error is not None:
        return Score(**facts, failed=record.error)
    try:
        truth = read_tum(sequence.truth_file(system.frame))
        result = evaluate(
            _seen(truth, sequence) if system.is_visual else truth,
            read_tum(folder / ESTIMATE),
            alignment=system.alignment,
            association=Association.INTERPOLATED,
            # A sweep's end may lie an interval past the last true pose.
            expected=max(record.frames - 1, 1),
        )
    except CarlaLocError as error:
        return Score(**facts, failed=str(error))
    PathErrors.of(result, job.title).save(folder / ERRORS)
    facts["findings"] = "; ".join(filter(None, [job.sequence.findings, *result.findings]))
    sensor = sequence.lidar if system.sensor == "lidar" else sequence.stereo[0]
    rmse = {metric: statistics.rmse for metric, statistics in result.statistics.items()}
    attitude_deg = float("nan")
    if Metric.APE_ROTATION in rmse:
        attitude_deg = Statistics.of(attitude_errors_deg(result.truth, result.estimate)).rmse
    return Score(
        **facts,
        failed=rule.why_failed(result),
        ape_m=rmse[Metric.APE_TRANSLATION],
        ape_deg=rmse.get(Metric.APE_ROTATION, float("nan")),
        attitude_deg=attitude_deg,
        rpe_paper_m=rmse[Metric.RPE_PAPER],
        rpe_m=rmse.get(Metric.RPE_TRANSLATION, float("nan")),
        kitti_percent=_mean([(s.translation_percent, s.segments) for s in result.segments]),
        kitti_deg_per_m=_mean([(s.rotation_deg_per_m, s.segments) for s in result.segments]),
        coverage=result.coverage,
        time_coverage=result.covered.share,
        length_m=result.truth.length_m,
        real_time=record.frame_median_s * float(sensor.rate_hz),
    )


def _seen(truth: Trajectory, sequence: SlamSequence) -> Trajectory:
    """Truth of the time that has images: a replay may make them of a part of its stretch alone."""
    try:
        stamp_ns = sequence.image_stamps()
    except EvaluationError:
        return truth  # streamed images are not kept; they show the whole stretch
    if len(stamp_ns) < 2:
        return truth
    margin_ns = int(np.diff(stamp_ns).min())
    inside = (truth.stamp_ns >= stamp_ns[0] - margin_ns) & (truth.stamp_ns <= stamp_ns[-1] + margin_ns)
    return truth.take(np.flatnonzero(inside))


def _mean(weighted: list[tuple[float, int]]) -> float:
    """Mean of values by their weights; NaN if all of those are 0."""
    weight = sum(count for _, count in weighted)
    return sum(value * count for value, count in weighted) / weight if weight else float("nan")
