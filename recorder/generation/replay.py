"""Replay an episode through a sensor rig, under any weather and traffic, and write datasets.

The drive is gone over once per traffic level: rays are cast and G-buffers drawn once, every
weather is shaded from them, and each condition has its own writers. Traffic levels run in
processes of their own. Nothing here simulates: sensors look at the recorded Timeline.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from shutil import rmtree
from typing import Any

import numpy as np

from carlaloc_env.core.clock import STEP_NS, TICK_NS
from carlaloc_env.core.errors import ConfigError, WriterError
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.rigs.rig import Rig, SensorRig
from carlaloc_env.samples import Sample
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.base import Camera
from carlaloc_env.sensors.camera.config import CameraConfig
from carlaloc_env.sensors.ground_truth.ego_truth import truth_at
from carlaloc_env.sensors.ground_truth.objects import objects_at
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.weather.schedule import Weather
from recorder.episode.episode import Episode
from recorder.episode.town import town_id_of, town_of
from recorder.episode.traffic_level import TrafficLevel
from recorder.generation.conditions import conditions_of
from recorder.generation.dataset_manifest import is_begun, origin_of, write_record
from recorder.generation.sequence_writers import (
    DatasetSequence,
    check_formats,
    sequence_writers,
    without_unwritten,
    write_shared,
)
from recorder.generation.worker_processes import run_jobs

Progress = Callable[[float, float], None]
"""Called with seconds of sensor data done and seconds in all, over all traffic levels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayConfig:
    """What to replay, under which conditions, and in which formats."""

    episode: Path
    """Episode to replay."""
    out: Path
    """Folder of the dataset; must not hold this town's sequences yet."""
    weathers: tuple[str, ...] = ("ClearNoon",)
    """Names of weathers, or paths of schedules (``.yaml``)."""
    traffic: tuple[str, ...] = ("dynamic",)
    """Traffic levels: ``static``, ``dynamic``, fractions."""
    rig: str = "paper"
    """Name of a rig, or a YAML file."""
    formats: tuple[str, ...] = ("rosbag1", "euroc")
    """Dataset formats."""
    topics: str = "standard"
    """Topic profile of bags."""
    start_s: float = 0.0
    """Beginning of the stretch [s]."""
    duration_s: float | None = None
    """Length of the stretch [s]; None: to the end of the drive."""
    camera_start_s: float | None = None
    """Beginning of the images [s]; None: that of the stretch."""
    camera_duration_s: float | None = None
    """Length of the images [s]; None: the whole stretch."""
    seed: int | None = None
    """Seed of sensor noise; None: the episode's."""
    quality: str = "medium"
    """Quality of images: ``low``, ``medium``, ``high``."""
    workers: int | None = None
    """Processes; None: one per core."""
    preview: bool = True
    """Whether a film of each sequence is made."""
    lens_drops: bool = False
    """Whether drops cling to the lenses of all cameras while it rains."""
    leaf_wind_mps: float = 0.0
    """Wind that sways leaves in all images [m/s]; 0: as the rig says."""

    def __post_init__(self) -> None:
        check_formats(self.formats)
        if self.start_s < 0 or (self.duration_s is not None and self.duration_s <= 0):
            raise ConfigError("start must not be negative and duration must be above zero")
        if self.workers is not None and self.workers < 1:
            raise ConfigError(f"{self.workers} workers; give at least 1")


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayResult:
    """What was written."""

    out: Path
    """Folder of the dataset."""
    sequences: tuple[Path, ...]
    """Folder of each sequence."""
    ground_truth: Path
    """Folder of the true trajectories."""
    samples: dict[str, int]
    """Number of samples of each stream, over all sequences."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Job:
    """One traffic level of a replay, as a worker gets it."""

    config: ReplayConfig
    level: TrafficLevel
    sequences: tuple[DatasetSequence, ...]
    span_ns: tuple[int, int]
    camera_ns: tuple[int, int]
    seed: int


def rig_of(config: ReplayConfig) -> SensorRig:
    """The rig of a replay, with the options that it sets for all cameras.

    Raises:
        ConfigError: there is no such rig, or an option is out of range.
    """
    rig = rig_by_name(config.rig)
    changes: dict[str, Any] = {}
    if config.lens_drops:
        changes["lens_drops"] = True
    if config.leaf_wind_mps:
        changes["leaf_wind_mps"] = config.leaf_wind_mps
    if not changes:
        return rig
    sensors = tuple(replace(s, **changes) if isinstance(s, CameraConfig) else s for s in rig.sensors)
    return replace(rig, sensors=sensors)


def replay(config: ReplayConfig, progress: Progress | None = None) -> ReplayResult:
    """Replay an episode and write all its sequences.

    Args:
        config: What to replay.
        progress: Told about every second how far all levels are.

    Raises:
        ConfigError: an unknown rig, weather, format or level, or a stretch outside the drive.
        EpisodeError: the episode cannot be read, or its map has changed since.
        WriterError: a sequence exists already or cannot be written.
    """
    conditions = conditions_of(config.weathers, config.traffic)
    rig = rig_of(config)
    episode = Episode.load(config.episode)
    town = town_id_of(episode)
    timeline = episode.timeline()
    span, cameras = _spans(config, rig, timeline)
    seed = episode.header.seed if config.seed is None else config.seed
    town_dir = config.out / town.name
    jobs = [
        _Job(
            config=config,
            level=level,
            sequences=tuple(
                DatasetSequence(condition=c, folder=town_dir / c.name)
                for c in conditions
                if c.traffic == level
            ),
            span_ns=span,
            camera_ns=cameras,
            seed=seed,
        )
        for level in dict.fromkeys(condition.traffic for condition in conditions)
    ]
    for job in jobs:
        for sequence in job.sequences:
            if sequence.folder.exists():
                raise WriterError(f"{sequence.folder} exists; choose another --out or delete it first")
    origin = origin_of(town, episode, rig, seed=seed, span_ns=span, topics=config.topics)
    begun, fresh = is_begun(config.out, origin), not town_dir.exists()
    try:
        if not begun:
            write_shared(town_dir, rig, timeline, span, topics=config.topics, seed=seed)
        counts = _run(jobs, config.workers, progress)
    except BaseException:
        if fresh:
            rmtree(town_dir, ignore_errors=True)
        raise
    sequences = tuple(sequence.folder for job in jobs for sequence in job.sequences)
    write_record(config.out, origin)
    return ReplayResult(
        out=config.out,
        sequences=sequences,
        ground_truth=town_dir / "ground_truth",
        samples=dict(sorted(counts.items())),
    )


def _spans(
    config: ReplayConfig, rig: SensorRig, timeline: Timeline
) -> tuple[tuple[int, int], tuple[int, int]]:
    """Stretch of all sensors and of the cameras [ns], whole steps."""
    last = timeline.end_ns // STEP_NS * STEP_NS
    first = round(config.start_s * 1e9) // STEP_NS * STEP_NS
    end = last if config.duration_s is None else first + round(config.duration_s * 1e9) // STEP_NS * STEP_NS
    if first >= last:
        raise ConfigError(
            f"the stretch begins at {config.start_s:g} s, but the drive ends at {last / 1e9:g} s; "
            "give a smaller --start"
        )
    end = min(end, last)
    begin = first if config.camera_start_s is None else round(config.camera_start_s * 1e9)
    length = end if config.camera_duration_s is None else begin + round(config.camera_duration_s * 1e9)
    return (first, end), (max(begin, first), min(length, end))


def _run(jobs: list[_Job], workers: int | None, progress: Progress | None) -> dict[str, int]:
    total_s = sum((job.span_ns[1] - job.span_ns[0]) / 1e9 for job in jobs)
    done = [0.0] * len(jobs)

    def report(number: int, done_s: float) -> None:
        done[number] = done_s
        if progress is not None:
            progress(sum(done), total_s)

    count = min(workers or os.cpu_count() or 1, len(jobs))
    try:
        results = run_jobs(_replay_level, jobs, count, report)
    except BaseException:
        for job in jobs:
            for sequence in job.sequences:
                rmtree(sequence.part, ignore_errors=True)
        raise
    return {name: sum(r.get(name, 0) for r in results) for result in results for name in result}


def _replay_level(job: _Job, report: Callable[[float], None]) -> dict[str, int]:
    episode = Episode.load(job.config.episode)
    timeline = job.level.select(episode.timeline())
    config = without_unwritten(rig_of(job.config), job.config.formats, job.config.topics)
    # Nobody else holds the town here, so that the stage can let its meshes go.
    stage = SensorStage(
        town_of(episode),
        seed=job.seed,
        weather=job.sequences[0].condition.weather,
        quality=job.config.quality,
    )
    rig = config.build(stage)
    objects = _object_truth(config, stage)
    writers = [
        sequence_writers(
            sequence,
            config,
            tuple(rig.streams),
            formats=job.config.formats,
            topics=job.config.topics,
            preview=job.config.preview,
            seed=job.seed,
        )
        for sequence in job.sequences
    ]
    counts: dict[str, int] = {}
    try:
        for group in writers:
            group.open()
        weathers = [sequence.condition.weather for sequence in job.sequences]
        first, end = job.span_ns
        for begin in range(first, end, STEP_NS):
            window = (begin, min(begin + STEP_NS, end))
            rows = measure_window(rig, timeline, window, job.camera_ns, weathers, objects)
            for group, samples in zip(writers, rows, strict=True):
                for sample in samples:
                    group.write(sample)
                    counts[sample.sensor] = counts.get(sample.sensor, 0) + 1
            report((window[1] - first) / 1e9)
        for group in writers:
            group.close()
    except BaseException:
        for group in writers:
            group.abort()
        raise
    finally:
        stage.close()
    return counts


def _object_truth(config: SensorRig, stage: SensorStage) -> Callable[[Timeline, int], Sample]:
    """Truth of all actors; rigs without rays do without visibility, so that they need no Open3D."""
    eyes = [sensor.mount.position_m for kind in ("lidar", "radar") for sensor in config.of_kind(kind)]
    if not eyes:
        return objects_at
    return partial(objects_at, rays=stage.rays(), eye_m=eyes[0])


def measure_window(
    rig: Rig,
    timeline: Timeline,
    window_ns: tuple[int, int],
    camera_ns: tuple[int, int],
    weathers: list[Weather],
    objects: Callable[[Timeline, int], Sample] | None = None,
) -> list[list[Sample]]:
    """Samples with stamps in a window [ns], ordered by stamp, one list per weather.

    Args:
        rig: The sensors.
        timeline: The drive.
        window_ns: Beginning and end (not included).
        camera_ns: Stretch in which cameras take images.
        weathers: Weathers of images and of sensors that feel the weather; all other samples are shared.
        objects: Gives the truth of all actors at a stamp [ns]; None: left out.
    """
    first, end = window_ns
    shared: list[tuple[int, int, Sample]] = []
    images: list[list[tuple[int, int, Sample]]] = [[] for _ in weathers]
    for index, sensor in enumerate(rig.sensors):
        stamps = [
            stamp
            for stamp in sensor.schedule.stamps_ns_in(first, end)
            if stamp + sensor.latency_ns <= timeline.end_ns
        ]
        if isinstance(sensor, Camera):
            for stamp in stamps:
                if camera_ns[0] <= stamp < camera_ns[1]:
                    shots = sensor.measure_conditions(timeline, stamp, weathers)
                    for row, samples in zip(images, shots, strict=True):
                        row += [(stamp, index, sample) for sample in samples]
        elif sensor.depends_on_weather:
            for stamp in stamps:
                versions = sensor.measure_conditions(timeline, stamp, [w.at(stamp) for w in weathers])
                for row, samples in zip(images, versions, strict=True):
                    row += [(stamp, index, sample) for sample in samples]
        else:
            shared += [(sample.stamp_ns, index, sample) for sample in sensor.measure(timeline, stamps)]
    if objects is not None:
        steps = range(-(-first // STEP_NS) * STEP_NS, end, STEP_NS)
        shared += [(stamp, -1, objects(timeline, stamp)) for stamp in steps]
    ticks = np.arange(first, end, TICK_NS)
    shared += [(truth.stamp_ns, -1, truth) for truth in truth_at(timeline, ticks.tolist(), np.eye(4))]
    return [[sample for _, _, sample in sorted(shared + row, key=lambda item: item[:2])] for row in images]
