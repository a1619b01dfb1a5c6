"""Batches of runs over drives that are read as they are made: one feed for all that share its work.

A batch has a process that makes the frames ahead, on cores of its own, and a lane for each worker, in which
systems take turns frame by frame. A program that reads files gets a bag of its own, see `files_for`.
"""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from carlaloc_env.core.errors import CarlaLocError
from recorder.benchmark.plan import Job
from recorder.dataset.layout import SequenceFolder
from recorder.dataset.sequence import SEGMENTED
from recorder.replaying.replay import replay
from recorder.slam.supervisor import RunRecord, run_isolated
from recorder.slam.system_file import is_system_file
from recorder.streaming.drive import DriveStream
from recorder.streaming.frames import FrameJob, Key
from recorder.streaming.run_feed import RunningFeed

TOGETHER = 8
"""Most systems of a batch: each is a process with a map of its own in memory."""
FEED, BAGS = "feed", "bags"
"""Folders of a batch's feed and of bags for programs, below the benchmark's folder; emptied after each."""

Ended = Callable[[Job, RunRecord], None]
"""Told of each run that has ended."""


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
        streams = [stream_of(job) for job in self.jobs]
        return [(stream.weather, stream.seed) for stream in streams]


def stream_of(job: Job) -> DriveStream:
    """What the data of a run are made of."""
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
        key = (stream.plan.recipe.episode, stream.condition.traffic, sensor, seed)
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
    seeds = tuple(dict.fromkeys(stream_of(job).seed for job in jobs))
    return Batch(frames=replace(frames, seeds=seeds), jobs=tuple(jobs))


def run_batch(
    batch: Batch,
    out: Path,
    *,
    cores: Sequence[int],
    workers: int,
    limit_s: Callable[[Job], float],
    stop: threading.Event,
    ended: Ended,
) -> None:
    """Run a batch; a run that fails is a record like any other.

    Args:
        batch: What to run.
        out: The benchmark's folder.
        cores: Cores that may be used.
        workers: Number of lanes.
        limit_s: Longest time of a run on the clock, were it alone [s].
        stop: Ends all runs when it is set.
        ended: Told of each run, when the feed's shares of movers are written down.
    """
    own, lanes = share_cores(cores, workers)
    numbers = [range(lane, len(batch.jobs), workers) for lane in range(workers)]
    keys = batch.keys
    records: dict[int, RunRecord] = {}
    with RunningFeed(batch.frames, [[keys[k] for k in lane] for lane in numbers], out / FEED, own) as feed:
        ends = {k: end for lane, found in zip(numbers, feed.connections, strict=True)
                for k, end in zip(lane, found, strict=True)}  # fmt: skip

        def work(k: int) -> None:
            job = batch.jobs[k]
            records[k] = run_isolated(
                job.method,
                job.sequence.path,
                out / job.folder,
                cloud=job.cloud,
                limit_s=limit_s(job) * len(batch.jobs),
                cores=lanes[k % workers],
                stop=stop,
                feed=ends[k],
            )

        with ThreadPoolExecutor(len(batch.jobs)) as pool:
            futures = [pool.submit(work, k) for k in range(len(batch.jobs))]
            try:
                for future in futures:
                    future.result()
            except BaseException:
                stop.set()
                raise
        try:
            shares, fault = feed.wait(), None
        except CarlaLocError as error:
            shares, fault = {}, str(error)
    for stream in {stream_of(job).folder.path: stream_of(job) for job in batch.jobs}.values():
        if shares:
            stream.tell_movers(shares)
    for k, job in enumerate(batch.jobs):
        ended(job, records[k] if fault is None else replace(records[k], error=fault))
    shutil.rmtree(out / FEED, ignore_errors=True)


def share_cores(cores: Sequence[int], workers: int) -> tuple[tuple[int, ...], list[tuple[int, ...]]]:
    """Cores of the feed and of each lane; with fewer cores than lanes and feed, all share all."""
    share = len(cores) // (workers + 1)
    if not share:
        return tuple(cores), [tuple(cores)] * workers
    lanes = [tuple(cores[k * share : (k + 1) * share]) for k in range(workers)]
    return tuple(cores[workers * share :]), lanes


def runs_on_files(job: Job) -> bool:
    """Whether a run's system is a program that reads files."""
    return is_system_file(job.method)


@contextmanager
def files_for(job: Job, out: Path) -> Iterator[Path]:
    """Folder of a sequence with a bag and images for programs, deleted afterwards.

    Raises:
        CarlaLocError: it cannot be made; a full disk is one line.
    """
    stream, folder = stream_of(job), out / BAGS
    shutil.rmtree(folder, ignore_errors=True)
    try:
        folder.mkdir(parents=True)
        replay(stream.alone(folder / "data", sensor=job.system.sensor))
        yield SequenceFolder(folder / "data" / job.sequence.town / job.sequence.path.name).path
    finally:
        shutil.rmtree(folder, ignore_errors=True)
