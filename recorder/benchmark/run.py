"""Runs a benchmark over folders or drives: systems in processes of their own, results kept as they come."""

from __future__ import annotations

import hashlib
import json
import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from pathlib import Path

from carlaloc_env.core.errors import ConfigError, MissingDependencyError, unknown_name
from carlaloc_env.core.files.last_line import last_line
from recorder.benchmark.batches import batches_of, files_for, run_batch, runs_on_files
from recorder.benchmark.plan import BenchmarkSequence, Job, find_sequences, plan_jobs, sequences_of
from recorder.benchmark.score import ERRORS, Score, read_score, score_run, write_score
from recorder.dataset.layout import SequenceFolder
from recorder.dataset.sequence import RAW, SEGMENTED
from recorder.evaluation.failure import FailRule
from recorder.evaluation.path_errors import PathErrors
from recorder.slam.supervisor import LOG, RunRecord, run_isolated
from recorder.slam.systems import SYSTEMS, system_of
from recorder.streaming.drive import DriveConfig

AGAIN = ("failed", "all")
"""Which kept results may be made again."""
Progress = Callable[[int, int, str], None]
"""Told jobs done, jobs in all and the job that has ended."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchmarkConfig:
    """What to run and how."""

    data: Path | DriveConfig
    """Folder with sequences, or drives that are read as they are made."""
    out: Path
    """Folder of the results; those that lie there already are not run again."""
    methods: tuple[str, ...] = ()
    """Names or files of systems; empty: all that are installed."""
    runs: int = 1
    """Repetitions, since systems are not deterministic."""
    workers: int = 1
    """Runs at a time, each on its own cores."""
    clouds: tuple[str, ...] = (RAW, SEGMENTED)
    """Which points LiDAR systems get."""
    limit_per_second: float = 20.0
    """Longest time of a run by the length of its sequence."""
    rule: FailRule = field(default_factory=FailRule)
    """When a run counts as failed."""
    again: str | None = None
    """Which kept results are made again: ``failed`` or ``all`` of them; None: none."""

    def __post_init__(self) -> None:
        cores = len(_cores())
        if not 1 <= self.workers <= cores:
            raise ConfigError(f"{self.workers} workers; this machine has {cores} cores, one run needs one")
        for cloud in self.clouds:
            if cloud not in (RAW, SEGMENTED):
                raise ConfigError(f"no clouds '{cloud}'; choose from {RAW}, {SEGMENTED}")
        if self.again not in (None, *AGAIN):
            raise ConfigError(unknown_name("results", str(self.again), AGAIN))


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchmarkResult:
    """All that a benchmark has found."""

    sequences: list[BenchmarkSequence]
    """Sequences, sorted."""
    jobs: list[Job]
    """Jobs, in the order of the plan."""
    scores: list[Score]
    """Their scores."""
    reused: int
    """Scores that had been there before."""
    out: Path
    """Folder of the results."""

    @property
    def failures(self) -> list[str]:
        """A line for each failed run: the system, where it ran, why it failed, its log and how that ends."""
        lines = []
        for job, score in zip(self.jobs, self.scores, strict=True):
            if score.failed is not None:
                log = self.out / job.folder / LOG
                printed = last_line(log, but=score.failed)
                ending = f", which ends with: {printed}" if printed else ""
                where = f"{job.sequence.key}, run {job.run}"
                why = score.failed.removesuffix("; see log.txt")
                lines.append(f"{job.title} failed in {where}: {why}; log: {log}{ending}")
        return lines

    def errors(self) -> list[tuple[Job, PathErrors]]:
        """Errors of all runs that gave an estimate, failed by divergence or not.

        Raises:
            EvaluationError: a file of them is gone or damaged.
        """
        pairs = zip(self.jobs, self.scores, strict=True)
        return [(job, PathErrors.load(self.out / job.folder / ERRORS)) for job, s in pairs if s.coverage > 0]


def run_benchmark(config: BenchmarkConfig, progress: Progress | None = None) -> BenchmarkResult:
    """Run every system over every sequence.

    A system that is missing when asked for by name ends it at once; a run that fails is a row like any other.

    Raises:
        ConfigError: there is no sequence or no such system.
        MissingDependencyError: a system that was asked for is not installed.
    """
    data = config.data
    sequences = find_sequences(data) if isinstance(data, Path) else sequences_of(data, config.out)
    words = config.methods or tuple(name for name, system in SYSTEMS.items() if system.is_installed)
    systems = [(word, system_of(word)) for word in words]
    for _, system in systems:
        if system.missing:
            raise MissingDependencyError(system.missing)
    jobs = plan_jobs(sequences, systems, runs=config.runs, clouds=config.clouds)
    if not jobs:
        raise ConfigError("nothing to run; choose other methods or clouds")
    config.out.mkdir(parents=True, exist_ok=True)
    found: dict[int, Score] = {}
    for k, job in enumerate(jobs):
        kept = read_score(config.out / job.folder, _fingerprint(job, config))
        again = config.again == "all" or (config.again == "failed" and kept and kept.failed is not None)
        if kept is not None and not again:
            found[k] = kept
    reused = len(found)
    run = _Run(jobs, found, config, progress or _nobody)
    run.all_of([k for k in range(len(jobs)) if k not in found])
    scores = [found[k] for k in range(len(jobs))]
    return BenchmarkResult(sequences=sequences, jobs=jobs, scores=scores, reused=reused, out=config.out)


def _nobody(done: int, total: int, told: str) -> None:
    """Listen to no progress."""


class _Run:
    """Runs jobs, and keeps their scores as they come."""

    def __init__(
        self, jobs: Sequence[Job], found: dict[int, Score], config: BenchmarkConfig, progress: Progress
    ) -> None:
        self._jobs, self._found, self._config, self._progress = jobs, found, config, progress
        self._cores, self._stop, self._lock = _cores(), threading.Event(), threading.Lock()

    def all_of(self, pending: Sequence[int]) -> None:
        """Run some jobs."""
        of_folders = [k for k in pending if self._jobs[k].sequence.stream is None]
        of_drives = [k for k in pending if self._jobs[k].sequence.stream is not None]
        self._beside(of_folders)
        self._batches([k for k in of_drives if not runs_on_files(self._jobs[k])])
        for k in of_drives:
            if runs_on_files(self._jobs[k]):
                with files_for(self._jobs[k], self._config.out) as folder:
                    self._alone(k, folder, self._cores)

    def _beside(self, pending: Sequence[int]) -> None:
        """Run jobs over folders, some at a time, each on its own cores."""
        workers = self._config.workers
        share = len(self._cores) // workers
        free = [self._cores[k * share : (k + 1) * share] for k in range(workers)]

        def work(k: int) -> None:
            with self._lock:
                mine = free.pop()
            try:
                self._alone(k, self._jobs[k].sequence.path, mine)
            finally:
                with self._lock:
                    free.append(mine)

        with ThreadPoolExecutor(workers) as pool:
            try:
                for future in as_completed([pool.submit(work, k) for k in pending]):
                    future.result()
            except BaseException:
                self._stop.set()
                pool.shutdown(cancel_futures=True)
                raise

    def _batches(self, pending: Sequence[int]) -> None:
        """Run jobs over drives, batch by batch."""
        numbers = {id(self._jobs[k]): k for k in pending}
        for batch in batches_of([self._jobs[k] for k in pending]):
            run_batch(
                batch,
                self._config.out,
                cores=self._cores,
                workers=self._config.workers,
                limit_s=self._limit_s,
                stop=self._stop,
                ended=lambda job, record: self._ended(numbers[id(job)], record),
            )

    def _alone(self, k: int, folder: Path, cores: tuple[int, ...]) -> None:
        job = self._jobs[k]
        record = run_isolated(
            job.method,
            folder,
            self._config.out / job.folder,
            cloud=job.cloud,
            limit_s=self._limit_s(job),
            cores=cores,
            stop=self._stop,
        )
        self._ended(k, record)

    def _limit_s(self, job: Job) -> float:
        return 60.0 + self._config.limit_per_second * _duration_s(job.sequence)

    def _ended(self, k: int, record: RunRecord) -> None:
        """Score a run, keep the score, and tell of it."""
        job, config = self._jobs[k], self._config
        folder = config.out / job.folder
        score = score_run(job, folder, record, config.rule)
        write_score(folder, score, record, _fingerprint(job, config))
        told = f"fail: {score.failed}" if score.failed else f"APE {score.ape_m:.3f} m"
        with self._lock:
            self._found[k] = score
            self._progress(len(self._found), len(self._jobs), f"{job.folder.relative_to('runs')}: {told}")


def _duration_s(sequence: BenchmarkSequence) -> float:
    """Length of the truth [s], by its first and last lines."""
    with SequenceFolder(sequence.path).drive.truth("base_link").open("rb") as file:
        file.readline()
        first = float(file.readline().split()[0])
        file.seek(max(file.seek(0, os.SEEK_END) - 1000, 0))
        return float(file.read().splitlines()[-1].split()[0]) - first


def _fingerprint(job: Job, config: BenchmarkConfig) -> str:
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


def _cores() -> tuple[int, ...]:
    if hasattr(os, "sched_getaffinity"):
        return tuple(sorted(os.sched_getaffinity(0)))
    return tuple(range(os.cpu_count() or 1))
