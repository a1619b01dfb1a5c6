"""Runs a benchmark over folders or drives: systems in processes of their own, results kept as they come."""

import logging
import shutil
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path

from carlaloc_env.core.cores import usable_cores
from carlaloc_env.core.errors import ConfigError, EvaluationError, MissingDependencyError
from carlaloc_env.core.files.text_files import last_line
from recorder.benchmark.batches import FEEDS, BatchWork, batches_of, lacks, run_batch, run_on_files
from recorder.benchmark.config import BenchmarkConfig
from recorder.benchmark.notes import notes_on
from recorder.benchmark.plan import BenchmarkSequence, Job, find_sequences, plan_jobs, sequences_of
from recorder.benchmark.results import fingerprint_of, keep, read_result, run_job
from recorder.benchmark.score import ERRORS, Score
from recorder.dataset.sequence import SlamSequence, faults_of
from recorder.evaluation.path_errors import PathErrors
from recorder.replaying.unit_work import STOP
from recorder.replaying.workers import DaskCluster, Task, ThisProcess, Workers, run_tasks
from recorder.slam.supervisor import LOG, RunRecord
from recorder.slam.system_file import is_system_file
from recorder.slam.systems import SYSTEMS, system_of

__all__ = ["BenchmarkConfig", "BenchmarkResult", "Progress", "run_benchmark"]

_LOG = logging.getLogger(__name__)
Progress = Callable[[float, int, str | None], None]
"""Called with jobs done, jobs in all, and the job that has ended, if one has."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchmarkResult:
    """Runs of a benchmark and their scores."""

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


def run_benchmark(
    config: BenchmarkConfig,
    progress: Progress = lambda *_: None,
    *,
    sequences: Sequence[BenchmarkSequence] | None = None,
) -> BenchmarkResult:
    """Run every system over every sequence.

    Args:
        config: Data, systems and settings.
        progress: Called with the progress.
        sequences: Sequences to run on; None: those that the configuration names.

    A system that is missing when asked for by name ends it at once; a run that fails is a row like any other.

    Raises:
        ConfigError: there is no sequence or no such system.
        MissingDependencyError: a system that was asked for is not installed.
    """
    data = config.data
    if sequences is None:
        if isinstance(data, Path):
            sequences = find_sequences(data, config.lidar)
        else:
            sequences = sequences_of(data, config.out)
    words = config.methods or tuple(name for name, system in SYSTEMS.items() if system.is_installed)
    systems = [(word, system_of(word)) for word in words]
    for _, system in systems:
        if system.missing:
            raise MissingDependencyError(system.missing)
    jobs = plan_jobs(sequences, systems, runs=config.runs, clouds=config.clouds)
    if not jobs:
        raise ConfigError("nothing to run; choose other methods or clouds")
    for note in notes_on(sequences, [system for _, system in systems]):
        _LOG.warning("%s", note)
    config.out.mkdir(parents=True, exist_ok=True)
    scored: dict[int, Score] = {}
    fingerprints = {job.folder: fingerprint_of(job, config) for job in jobs}
    for k, job in enumerate(jobs):
        score, depended = read_result(job, config) or (None, "")
        if score is None or depended != fingerprints[job.folder] or config.again == "all":
            continue
        # A program's build is unknown here, so that its failure does not last; what was scored does.
        lost = score.coverage == 0 and is_system_file(job.method)
        if not lost and (config.again != "failed" or score.failed is None):
            scored[k] = score
    reused = len(scored)
    pending = [job for k, job in enumerate(jobs) if k not in scored]
    looked = {one.path: _looked_at(one, pending) for one in sequences}
    sequences = list(looked.values())
    jobs = [replace(job, sequence=looked[job.sequence.path]) for job in jobs]
    run = _Run(jobs, scored, config, fingerprints, progress)
    try:
        run.all_of([k for k in range(len(jobs)) if k not in scored])
    except KeyboardInterrupt:
        kept = f"{len(scored)} of {len(jobs)} runs are kept, and the same command resumes from there"
        raise KeyboardInterrupt(kept) from None
    except OSError as error:
        why = f"cannot write below {config.out}: {error.strerror or error}"
        raise EvaluationError(f"{why}; make room, and the same command resumes from there") from error
    # How much of a drive moves is known when it has been read.
    movers = {sequence.key: sequence.movers for sequence in sequences}
    scores = [replace(scored[k], movers=movers[job.sequence.key]) for k, job in enumerate(jobs)]
    return BenchmarkResult(sequences=list(sequences), jobs=jobs, scores=scores, reused=reused, out=config.out)


def _looked_at(sequence: BenchmarkSequence, pending: Sequence[Job]) -> BenchmarkSequence:
    """A sequence with the faults of its data that no setting made, reported before systems run over them."""
    needs = {need for job in pending if job.sequence.path == sequence.path for need in job.system.needs}
    if not needs or sequence.stream is not None or sequence.faults:
        return sequence
    read = SlamSequence(sequence.path, lidar=sequence.lidar)
    findings = "; ".join(faults_of(read, with_imu="imu" in needs))
    if findings:
        _LOG.warning("%s: %s", sequence.key, findings)
    return replace(sequence, findings=findings)


class _Run:
    """Runs jobs, and keeps their scores as they come."""

    def __init__(
        self,
        jobs: Sequence[Job],
        scored: dict[int, Score],
        config: BenchmarkConfig,
        fingerprints: Mapping[Path, str],
        progress: Progress,
    ) -> None:
        self._jobs, self._scored, self._config, self._progress = jobs, scored, config, progress
        self._fingerprints = fingerprints
        self._numbers = {job.folder: k for k, job in enumerate(jobs)}
        self._stop, self._lock = threading.Event(), threading.Lock()

    def all_of(self, pending: Sequence[int]) -> None:
        """Run some jobs."""
        jobs = [self._jobs[k] for k in pending]
        # Systems with cameras take longest: begun first, they leave no core idle at the end.
        beside = [job for job in jobs if job.sequence.stream is None]
        self._beside(sorted(beside, key=lambda job: not job.system.is_visual))
        of_drives = [job for job in jobs if job.sequence.stream is not None]
        lacking = {job.folder: lack for job in of_drives if (lack := lacks(job)) is not None}
        for job in of_drives:
            if job.folder in lacking:
                self._ended(job, self._kept(job, RunRecord.of_error(lacking[job.folder])))
        of_drives = [job for job in of_drives if job.folder not in lacking]
        self._batches([job for job in of_drives if not is_system_file(job.method)])
        programs = [job for job in of_drives if is_system_file(job.method)]
        for job, score in run_on_files(programs, self._config, self._fingerprints):
            self._ended(job, score)

    def _kept(self, job: Job, record: RunRecord) -> Score:
        return keep(job, record, self._config, self._fingerprints[job.folder])

    def _beside(self, jobs: Sequence[Job]) -> None:
        """Run jobs over folders, some at a time, each on its own cores."""
        workers, cores = self._config.workers, usable_cores()
        share = len(cores) // workers
        free = [cores[k * share : (k + 1) * share] for k in range(workers)]

        def work(job: Job) -> None:
            with self._lock:
                mine = free.pop()
            try:
                self._ended(job, self._kept(job, run_job(job, self._config, mine, stop=self._stop)))
            finally:
                with self._lock:
                    free.append(mine)

        with ThreadPoolExecutor(workers) as pool:
            try:
                for future in as_completed([pool.submit(work, job) for job in jobs]):
                    future.result()
            except BaseException:
                self._stop.set()
                pool.shutdown(cancel_futures=True)
                raise

    def _batches(self, jobs: Sequence[Job]) -> None:
        """Run jobs over drives, batch by batch, here or on a cluster."""
        config = self._config
        folder = config.out / FEEDS
        if not jobs:
            return
        shutil.rmtree(folder, ignore_errors=True)
        tasks = []
        for number, batch in enumerate(batches_of(jobs)):
            work = BatchWork(
                batch=batch,
                config=config,
                fingerprints=tuple(self._fingerprints[job.folder] for job in batch.jobs),
                folder=(folder / f"{number}").resolve(),
            )
            work.folder.mkdir(parents=True)
            tasks.append(Task(run_batch, work, work.folder / "progress"))
        workers: Workers = ThisProcess(self._report, lambda: None)
        if config.cluster is not None:
            workers = DaskCluster(config.cluster)
        try:
            run_tasks(tasks, workers, done=self._batch_ended, look=self._report)
        except BaseException:
            (folder / STOP).touch()
            raise
        shutil.rmtree(folder, ignore_errors=True)

    def _batch_ended(self, task: Task) -> list[Task]:
        for job in task.job.batch.jobs:
            result = read_result(job, self._config)
            if result is None:
                raise EvaluationError(f"{self._config.out / job.folder} holds no result that can be read")
            self._ended(job, result[0])
        return []

    def _report(self, done_s: Mapping[Task, float]) -> None:
        """Report progress, of runs under way the share of the drive that has been made for them."""
        part = sum(
            len(task.job.batch.jobs) * done / task.job.batch.frames.length_s for task, done in done_s.items()
        )
        self._progress(len(self._scored) + part, len(self._jobs), None)

    def _ended(self, job: Job, score: Score) -> None:
        """Store a score, and report it."""
        outcome = f"fail: {score.failed}" if score.failed else f"APE {score.ape_m:.3f} m"
        with self._lock:
            self._scored[self._numbers[job.folder]] = score
            self._progress(len(self._scored), len(self._jobs), f"{job.folder.relative_to('runs')}: {outcome}")
