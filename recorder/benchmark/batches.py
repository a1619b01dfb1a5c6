"""Batches of runs over drives that are read as they are made: one feed for all that share its work.

A batch has a process that makes the frames ahead, on cores of its own, and a lane for each worker, in which
systems take turns frame by frame. A program that reads files gets a bag of its own, see `run_on_files`.
"""

import shutil
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import groupby
from multiprocessing.connection import Connection
from pathlib import Path

from carlaloc_env.core.cores import usable_cores
from carlaloc_env.core.errors import CarlaLocError, EvaluationError
from recorder.benchmark.config import BenchmarkConfig
from recorder.benchmark.plan import Job
from recorder.benchmark.results import keep, keep_shared, run_job
from recorder.benchmark.score import Score
from recorder.dataset.layout import DatasetFolder
from recorder.dataset.sequence import SEGMENTED
from recorder.replaying.replay import replay
from recorder.replaying.unit_work import STOP
from recorder.slam.supervisor import RunRecord
from recorder.streaming.drive import DriveStream
from recorder.streaming.frames import FrameJob, Key
from recorder.streaming.running_feed import RunningFeed

TOGETHER = 8
"""Most systems of a batch: each is a process with a map of its own in memory."""
FEEDS, BAGS = "feeds", "bags"
"""Folders of feeds and of bags for programs, below the benchmark's folder; deleted at the end."""
_LOOK_S = 0.5
"""Time between two looks at how far a feed is [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Batch:
    """Runs that one feed serves."""

    frames: FrameJob
    """What it makes."""
    jobs: tuple[Job, ...]
    """The runs."""

    @property
    def keys(self) -> list[Key]:
        """Version of the frames that each run gets."""
        conditions = self.frames.recipe.conditions
        streams = [stream_of(job) for job in self.jobs]
        return [(conditions.index(stream.condition), stream.seed) for stream in streams]


def stream_of(job: Job) -> DriveStream:
    """Drive stream that makes the data of a run."""
    assert job.sequence.stream is not None
    return job.sequence.stream


def batches_of(jobs: Sequence[Job], together: int = TOGETHER) -> list[Batch]:
    """Batches of runs over drives: those that share a drive, its traffic and a kind of sensor.

    Sweeps of several seeds share their rays. Pictures of several seeds share nothing, so each has batches of
    its own.
    """
    groups: dict[object, list[Job]] = {}
    for job in jobs:
        stream, sensor = stream_of(job), job.system.sensor
        seed = stream.seed if sensor == "stereo" else None
        plan = stream.plan
        key = (plan.recipe.episode, plan.span_ns, repr(plan.rig), stream.condition.traffic, sensor, seed)
        groups.setdefault(key, []).append(job)
    return [
        _batch(group[begin : begin + together])
        for group in groups.values()
        for begin in range(0, len(group), together)
    ]


def _batch(jobs: Sequence[Job]) -> Batch:
    stream = stream_of(jobs[0])
    masks = any(job.cloud == SEGMENTED for job in jobs)
    frames = stream.frame_job(jobs[0].system.sensor, masks=masks)
    streams = [stream_of(job) for job in jobs]
    # Weathers of no run are not drawn.
    conditions = tuple(dict.fromkeys(stream.condition for stream in streams))
    frames = replace(
        frames,
        recipe=replace(frames.recipe, conditions=conditions),
        seeds=tuple(dict.fromkeys(stream.seed for stream in streams)),
    )
    return Batch(frames=frames, jobs=tuple(jobs))


def lacks(job: Job) -> str | None:
    """Sensors of a system that the rig of a drive lacks, as a message; None: it has all."""
    try:
        stream_of(job).frame_job(job.system.sensor, masks=False)
    except EvaluationError as error:
        return str(error)
    return None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BatchWork:
    """A batch, as a worker gets it."""

    batch: Batch
    """What to run."""
    config: BenchmarkConfig
    """The benchmark."""
    fingerprints: tuple[str, ...]
    """What each of its runs depends on."""
    folder: Path
    """Folder of its feed, which is there."""


def run_batch(work: BatchWork, report: Callable[[float], None]) -> None:
    """Run a batch and keep its results; a run that fails is a result like any other.

    Args:
        work: What to do.
        report: Called with the part of the drive made so far [s].

    Raises:
        KeyboardInterrupt: it was asked to end.
    """
    batch, config = work.batch, work.config
    feed_cores, lanes = share_cores(usable_cores(), config.workers)
    numbers = [range(lane, len(batch.jobs), config.workers) for lane in range(config.workers)]
    keys, stop, fault = batch.keys, threading.Event(), None

    def run(k: int, end: Connection) -> RunRecord:
        mine = lanes[k % config.workers]
        return run_job(batch.jobs[k], config, mine, together=len(batch.jobs), stop=stop, feed=end)

    asked = [[keys[k] for k in lane] for lane in numbers]
    with RunningFeed(batch.frames, asked, work.folder, feed_cores) as feed:
        ends = {k: end for lane, connections in zip(numbers, feed.connections, strict=True)
                for k, end in zip(lane, connections, strict=True)}  # fmt: skip
        with ThreadPoolExecutor(len(batch.jobs)) as pool:
            futures = [pool.submit(run, k, ends[k]) for k in range(len(batch.jobs))]
            try:
                while not all(future.done() for future in futures):
                    report(feed.made_s(_LOOK_S))
                    if (work.folder.parent / STOP).exists():
                        raise KeyboardInterrupt
                records = [future.result() for future in futures]
            except BaseException:
                stop.set()
                raise
        try:
            shares = feed.wait()
            keep_shared(config, feed.shared, len(batch.jobs))
            streams = [stream_of(job) for job in batch.jobs]
            for stream in {stream.plan.config.out: stream for stream in streams}.values():
                stream.write_movers(shares)
        except EvaluationError as error:
            fault = str(error)
    for job, record, fingerprint in zip(batch.jobs, records, work.fingerprints, strict=True):
        # A failure of the feed is none of the system.
        failed = fault is not None and record.error is not None
        keep(job, replace(record, error=fault) if failed else record, config, "" if failed else fingerprint)


def share_cores(cores: Sequence[int], workers: int) -> tuple[tuple[int, ...], list[tuple[int, ...]]]:
    """Cores of the feed and of each lane; with fewer cores than lanes and feed, all share all."""
    share = len(cores) // (workers + 1)
    if not share:
        return tuple(cores), [tuple(cores)] * workers
    lanes = [tuple(cores[k * share : (k + 1) * share]) for k in range(workers)]
    return tuple(cores[workers * share :]), lanes


def run_on_files(
    jobs: Sequence[Job], config: BenchmarkConfig, fingerprints: Mapping[Path, str]
) -> Iterator[tuple[Job, Score]]:
    """Run programs over a bag and images that those of one condition share, which are deleted afterwards.

    Args:
        jobs: The runs.
        config: The benchmark.
        fingerprints: What each depends on, by its folder.

    Raises:
        KeyboardInterrupt: it was asked to end.
    """
    folder = config.out / BAGS

    def what(job: Job) -> tuple[Path, str]:
        return job.sequence.path, job.system.sensor

    for (path, sensor), group in groupby(sorted(jobs, key=what), what):
        shutil.rmtree(folder, ignore_errors=True)
        some, fault = list(group), None
        try:
            folder.mkdir(parents=True)
            try:
                replay(stream_of(some[0]).alone(folder / "data", sensor=sensor))
            except CarlaLocError as error:
                fault = str(error)
            for job in some:
                if fault is not None:
                    yield job, keep(job, RunRecord.of_error(fault), config, "")
                    continue
                sequence = DatasetFolder(folder / "data").drive(path.parent.name).sequence(path.name)
                record = run_job(job, config, usable_cores(), sequence=sequence.path)
                yield job, keep(job, record, config, fingerprints[job.folder])
        finally:
            shutil.rmtree(folder, ignore_errors=True)
