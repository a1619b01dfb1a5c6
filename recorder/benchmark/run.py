"""Runs a benchmark: jobs in processes on cores of their own, results kept as they come."""

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
from recorder.benchmark.plan import BenchmarkSequence, Job, find_sequences, plan_jobs
from recorder.benchmark.score import ERRORS, Score, read_score, score_run, write_score
from recorder.dataset.layout import SequenceFolder
from recorder.dataset.sequence import RAW, SEGMENTED
from recorder.evaluation.failure import FailRule
from recorder.evaluation.path_errors import PathErrors
from recorder.slam.supervisor import LOG, last_line, run_isolated
from recorder.slam.systems import SYSTEMS, system_of

AGAIN = ("failed", "all")
"""Which kept results may be made again."""
Progress = Callable[[int, int, str], None]
"""Told jobs done, jobs in all and the job that has ended."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchmarkConfig:
    """What to run and how."""

    data: Path
    """Folder with sequences."""
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
                why = score.failed.removesuffix(f"; log: {log}")
                printed = last_line(log, but=f"{why}; see {LOG}")
                ending = f", which ends with: {printed}" if printed else ""
                where = f"{job.sequence.key}, run {job.run}"
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
    sequences = find_sequences(config.data)
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
        # A program's build is unknown here, so that its failure says nothing lasting; what was scored does.
        lost = kept is not None and kept.coverage == 0 and job.method.endswith((".yaml", ".yml"))
        failed = kept is not None and kept.failed is not None and config.again == "failed"
        again = config.again == "all" or lost or failed
        if kept is not None and not again:
            found[k] = kept
    reused = len(found)
    _run_all(jobs, [k for k in range(len(jobs)) if k not in found], found, config, progress)
    scores = [found[k] for k in range(len(jobs))]
    return BenchmarkResult(sequences=sequences, jobs=jobs, scores=scores, reused=reused, out=config.out)


def _run_all(
    jobs: Sequence[Job],
    pending: list[int],
    found: dict[int, Score],
    config: BenchmarkConfig,
    progress: Progress | None,
) -> None:
    cores = _cores()
    share = len(cores) // config.workers
    free = [cores[k * share : (k + 1) * share] for k in range(config.workers)]
    lock, stop = threading.Lock(), threading.Event()

    def work(k: int) -> int:
        with lock:
            mine = free.pop()
        try:
            found[k] = _run_one(jobs[k], config, mine, stop)
        finally:
            with lock:
                free.append(mine)
        return k

    with ThreadPoolExecutor(config.workers) as pool:
        try:
            for future in as_completed([pool.submit(work, k) for k in pending]):
                k = future.result()
                score = found[k]
                told = f"fail: {score.failed}" if score.failed else f"APE {score.ape_m:.3f} m"
                if progress is not None:
                    progress(len(found), len(jobs), f"{jobs[k].folder.relative_to('runs')}: {told}")
        except BaseException:
            stop.set()
            pool.shutdown(cancel_futures=True)
            raise


def _run_one(job: Job, config: BenchmarkConfig, cores: tuple[int, ...], stop: threading.Event) -> Score:
    folder = config.out / job.folder
    record = run_isolated(
        job.method,
        job.sequence.path,
        folder,
        cloud=job.cloud,
        limit_s=60.0 + config.limit_per_second * _duration_s(job.sequence),
        cores=cores,
        stop=stop,
    )
    score = score_run(job, folder, record, config.rule)
    write_score(folder, score, record, _fingerprint(job, config))
    return score


def _duration_s(sequence: BenchmarkSequence) -> float:
    """Length of the truth [s], by its first and last lines."""
    with SequenceFolder(sequence.path).drive.truth("base_link").open("rb") as file:
        file.readline()
        first = float(file.readline().split()[0])
        file.seek(max(file.seek(0, os.SEEK_END) - 1000, 0))
        return float(file.read().splitlines()[-1].split()[0]) - first


def _fingerprint(job: Job, config: BenchmarkConfig) -> str:
    """What a result depends on: the data, the system, its file and version, and the rule."""
    data = SequenceFolder(job.sequence.path).checksums.read_bytes()
    source = Path(job.method).read_bytes() if job.method.endswith((".py", ".yaml", ".yml")) else b""
    facts = [
        repr(job.system),
        job.system.version,
        job.cloud,
        json.dumps(asdict(config.rule)),
        f"{config.limit_per_second:g}",
    ]
    if job.system.file:
        given = Path(os.environ[job.system.file]).stat()
        facts.append(f"{given.st_size} {given.st_mtime_ns}")
    return hashlib.sha256(data + source + "\n".join(facts).encode()).hexdigest()[:32]


def _cores() -> tuple[int, ...]:
    if hasattr(os, "sched_getaffinity"):
        return tuple(sorted(os.sched_getaffinity(0)))
    return tuple(range(os.cpu_count() or 1))
