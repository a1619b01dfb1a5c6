"""The score of a run: errors of its estimate, what it cost, and whether it counts as failed."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from carlaloc_env.core.errors import CarlaLocError, EvaluationError
from recorder.benchmark.plan import Job
from recorder.dataset.sequence import SlamSequence
from recorder.evaluation.align import attitude_errors_deg
from recorder.evaluation.associate import Association
from recorder.evaluation.evaluate import EvaluationResult, evaluate
from recorder.evaluation.failure import FailRule
from recorder.evaluation.metrics import Metric
from recorder.evaluation.trajectory_files import read_tum
from recorder.slam.supervisor import RunRecord
from recorder.slam.worker import ESTIMATE

RESULT = "result.json"
_FORMAT = 3
"""Changes when older results would be read wrongly."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """One run in figures; NaN where there is none."""

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
    alignment: str = ""
    """What was fitted."""
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

    def to_mapping(self) -> dict[str, Any]:
        """The score as JSON values."""
        return asdict(self)


def evaluate_run(job: Job, folder: Path, frames: int) -> EvaluationResult:
    """Errors of a run's estimate against the truth of its own frame, interpolated to its stamps.

    Raises:
        EvaluationError: the estimate has too few poses, or poses of another time.
    """
    sequence = SlamSequence(job.sequence.path)
    return evaluate(
        read_tum(sequence.truth_file(job.system.frame)),
        read_tum(folder / ESTIMATE),
        alignment=job.system.alignment,
        association=Association.INTERPOLATED,
        # A sweep's end may lie an interval past the last true pose.
        expected=max(frames - 1, 1),
    )


def score_run(job: Job, folder: Path, record: RunRecord, rule: FailRule) -> Score:
    """The score of a run that has ended, however it did."""
    known: dict[str, Any] = {
        "dataset": job.sequence.dataset,
        "town": job.sequence.town,
        "weather": job.sequence.weather,
        "traffic": job.sequence.traffic,
        "cloud": job.cloud,
        "method": job.system.name,
        "title": job.system.title,
        "run": job.run,
        "version": record.version,
        "movers": job.sequence.movers,
        "visual": job.system.is_visual,
        "frame": job.system.frame,
        "instant": job.system.instant,
        "alignment": job.system.alignment.value,
        "wall_s": record.wall_s,
        "cpu_s": record.cpu_s,
        "peak_memory_mb": record.peak_memory_mb,
        "cores": record.cores,
        "frame_median_s": record.frame_median_s,
        "frame_p99_s": record.frame_p99_s,
    }
    if record.error is not None:
        return Score(**known, failed=record.error)
    try:
        result = evaluate_run(job, folder, record.frames)
    except CarlaLocError as error:
        return Score(**known, failed=str(error))
    segments = result.segments
    count = sum(segment.segments for segment in segments)
    return Score(
        **known,
        failed=rule.why_failed(result),
        ape_m=result.statistics[Metric.APE_TRANSLATION].rmse,
        ape_deg=result.statistics[Metric.APE_ROTATION].rmse,
        attitude_deg=float(np.sqrt(np.mean(attitude_errors_deg(result.truth, result.estimate) ** 2))),
        rpe_paper_m=result.statistics[Metric.RPE_PAPER].rmse,
        rpe_m=result.statistics[Metric.RPE_TRANSLATION].rmse,
        kitti_percent=sum(s.translation_percent * s.segments for s in segments) / count
        if count
        else float("nan"),
        kitti_deg_per_m=sum(s.rotation_deg_per_m * s.segments for s in segments) / count
        if count
        else float("nan"),
        coverage=result.coverage,
        length_m=result.truth.length_m,
        real_time=record.frame_median_s * _rate_hz(job),
    )


def _rate_hz(job: Job) -> float:
    sequence = SlamSequence(job.sequence.path)
    sensor = sequence.lidar if "lidar" in job.system.needs else sequence.stereo[0]
    return float(sensor.rate_hz)


def write_score(folder: Path, score: Score, record: RunRecord, fingerprint: str) -> None:
    """Keep a run's score, whole or not at all."""
    part = folder / f".{RESULT}.part"
    document = {
        "format": _FORMAT,
        "fingerprint": fingerprint,
        "score": score.to_mapping(),
        "record": record.to_mapping(),
    }
    part.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    part.replace(folder / RESULT)


def read_score(folder: Path, fingerprint: str) -> Score | None:
    """A score that was kept; None: there is none, or of another sequence, system or limit."""
    try:
        found = json.loads((folder / RESULT).read_text(encoding="utf-8"))
        if found["format"] != _FORMAT or found["fingerprint"] != fingerprint:
            return None
        return Score(**found["score"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def frames_of(folder: Path) -> int:
    """Frames that a kept run was fed with.

    Raises:
        EvaluationError: no result is kept there.
    """
    try:
        return int(json.loads((folder / RESULT).read_text(encoding="utf-8"))["record"]["frames"])
    except (OSError, ValueError, KeyError) as error:
        raise EvaluationError(f"{folder} holds no {RESULT}; run the benchmark again") from error
