"""Results of runs on the disk: each is kept with what it depends on, and holds while that is the same.

Configuration of a benchmark.

The score of a run: errors of its estimate, what it cost, and whether it counts as failed.
"""

import hashlib
import json
import os
import threading
from dataclasses import asdict, dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from carlaloc_env.core.cores import usable_cores
from carlaloc_env.core.errors import CarlaLocError, ConfigError, EvaluationError, unknown_name
from carlaloc_env.core.files.atomic_files import atomic_write
from recorder.benchmark.plan import BenchmarkSequence, Job
from recorder.dataset.layout import SequenceFolder
from recorder.dataset.sequence import RAW, SEGMENTED, SlamSequence
from recorder.evaluation.align import attitude_errors_deg
from recorder.evaluation.associate import Association
from recorder.evaluation.evaluate import evaluate
from recorder.evaluation.fail_rule import FailRule
from recorder.evaluation.metrics import Metric, Statistics
from recorder.evaluation.path_errors import PathErrors
from recorder.evaluation.trajectory import Trajectory
from recorder.evaluation.trajectory_files import read_tum
from recorder.slam.supervisor import RunRecord, run_isolated
from recorder.slam.worker import ESTIMATE
from recorder.streaming.drive import DriveConfig

AGAIN = ("failed", "all")
"""Which kept results may be made again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchmarkConfig:
    """Data, systems and settings of a benchmark."""

    data: Path | DriveConfig
    """Folder with sequences, or drives that are read as they are made."""
    out: Path
    """Folder of the results; those that lie there already are not run again."""
    methods: tuple[str, ...] = ()
    """Names or files of systems; empty: those that are installed."""
    runs: int = 1
    """Repetitions, since systems are not deterministic."""
    workers: int = 1
    """Runs at a time, each on its own cores."""
    cluster: str | None = None
    """Address of a Dask scheduler whose workers run systems over drives; None: this machine."""
    clouds: tuple[str, ...] = (RAW, SEGMENTED)
    """Which points LiDAR systems get."""
    limit_per_second: float = 20.0
    """Longest time of a run by the length of its sequence."""
    rule: FailRule = field(default_factory=FailRule)
    """When a run counts as failed."""
    again: str | None = None
    """Which kept results are made again: ``failed`` or ``all`` of them; None: none."""

    def __post_init__(self) -> None:
        found = len(usable_cores())
        if not 1 <= self.workers <= found:
            raise ConfigError(f"{self.workers} workers; {found} cores may be used, one run needs one")
        for cloud in self.clouds:
            if cloud not in (RAW, SEGMENTED):
                raise ConfigError(f"no clouds '{cloud}'; choose from {RAW}, {SEGMENTED}")
        if self.again not in (None, *AGAIN):
            raise ConfigError(unknown_name("results", str(self.again), AGAIN))
        if self.cluster is not None and isinstance(self.data, Path):
            raise ConfigError("a cluster runs systems over drives; give drives (.mcap), or no cluster")


ERRORS = "errors.npz"
"""File with the errors of all poses of a run."""


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


def score_run(job: Job, folder: Path, record: RunRecord, rule: FailRule) -> Score:
    """The score of a run that has ended, however it did; its errors are kept beside its estimate.

    Errors are against the truth of the system's own frame, interpolated to the stamps of its poses.
    """
    sequence, system = SlamSequence(job.sequence.path), job.system
    costs = ("version", "wall_s", "cpu_s", "peak_memory_mb", "cores", "frame_median_s", "frame_p99_s")
    known: dict[str, Any] = {
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
    if record.error is not None:
        return Score(**known, failed=record.error)
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
        return Score(**known, failed=str(error))
    PathErrors.of(result, job.title).save(folder / ERRORS)
    known["findings"] = "; ".join(filter(None, [job.sequence.findings, *result.findings]))
    sensor = sequence.lidar if system.sensor == "lidar" else sequence.stereo[0]
    rmse = {metric: statistics.rmse for metric, statistics in result.statistics.items()}
    attitude_deg = float("nan")
    if Metric.APE_ROTATION in rmse:
        attitude_deg = Statistics.of(attitude_errors_deg(result.truth, result.estimate)).rmse
    return Score(
        **known,
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


RESULT = "result.json"
"""File of a run with its score."""
SHARED = Path("runs", "shared.jsonl")
"""File of what runs over drives have shared, a line for each pass over a drive."""
_FORMAT = 4
"""Changes when older results would be read wrongly."""


def keep(job: Job, record: RunRecord, config: BenchmarkConfig, fingerprint: str) -> Score:
    """Score a run that has ended and keep the score, whole or not at all.

    Args:
        job: The run.
        record: How it ended.
        config: The benchmark.
        fingerprint: What the run depends on, as it was when it began; empty: the result is none of the
            system's, and the same command runs it again.
    """
    folder = config.out / job.folder
    folder.mkdir(parents=True, exist_ok=True)
    score = score_run(job, folder, record, config.rule)
    document = {
        "format": _FORMAT,
        "fingerprint": fingerprint,
        "score": asdict(score),
        "record": asdict(record),
    }
    with atomic_write(folder / RESULT) as part:
        part.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    return score


def keep_shared(config: BenchmarkConfig, shared: tuple[int, int], runs: int) -> None:
    """Write down how many instants of a drive were measured for some runs, and frames made of them."""
    line = json.dumps({"instants": shared[0], "frames": shared[1], "runs": runs})
    with (config.out / SHARED).open("a", encoding="utf-8") as file:
        file.write(line + "\n")


def read_shared(out: Path) -> list[dict[str, int]]:
    """All that `keep_shared` has written."""
    file = out / SHARED
    return [json.loads(line) for line in file.read_text().splitlines()] if file.is_file() else []


def read_result(job: Job, config: BenchmarkConfig) -> tuple[Score, str] | None:
    """The score of a run, and what that depended on; None: there is none that can be read."""
    try:
        found = json.loads((config.out / job.folder / RESULT).read_text(encoding="utf-8"))
        if found["format"] != _FORMAT:
            return None
        return Score(**found["score"]), str(found["fingerprint"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def run_job(
    job: Job,
    config: BenchmarkConfig,
    cores: tuple[int, ...],
    *,
    sequence: Path | None = None,
    together: int = 1,
    stop: threading.Event | None = None,
    feed: Connection | None = None,
) -> RunRecord:
    """Run a system over its sequence, see `run_isolated`.

    Args:
        job: The run.
        config: The benchmark.
        cores: Cores that it may use.
        sequence: Folder of the sequence where it is another one than the job's.
        together: Runs that take turns, so that each may take so many times as long.
        stop: Ends the run when it is set.
        feed: Connection to a feed.
    """
    return run_isolated(
        job.method, sequence or job.sequence.path, config.out / job.folder, cloud=job.cloud,
        limit_s=limit_s(job, config) * together, cores=cores, stop=stop, feed=feed,
    )  # fmt: skip


def limit_s(job: Job, config: BenchmarkConfig) -> float:
    """Longest time of a run on the clock [s]."""
    return 60.0 + config.limit_per_second * _duration_s(job.sequence)


def _duration_s(sequence: BenchmarkSequence) -> float:
    """Length of the truth [s], by its first and last lines."""
    with SequenceFolder(sequence.path).drive.truth("base_link").open("rb") as file:
        file.readline()
        first = float(file.readline().split()[0])
        file.seek(max(file.seek(0, os.SEEK_END) - 1000, 0))
        return float(file.read().splitlines()[-1].split()[0]) - first


def fingerprint_of(job: Job, config: BenchmarkConfig) -> str:
    """What a result depends on: the data, the system, its file and version, and the rule."""
    source = Path(job.method).read_bytes() if job.method.endswith((".py", ".yaml", ".yml")) else b""
    facts = [
        job.sequence.digest,
        repr(job.system),
        job.system.version,
        job.cloud,
        json.dumps(asdict(config.rule)),
        f"{config.limit_per_second:g}",
    ]
    if job.system.file:
        given = Path(os.environ[job.system.file]).stat()
        facts.append(f"{given.st_size} {given.st_mtime_ns}")
    return hashlib.sha256(source + "\n".join(facts).encode()).hexdigest()[:32]
