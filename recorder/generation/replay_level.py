"""One traffic level of a replay: the drive gone over once, every condition written by its own writers.

Rays are cast and G-buffers drawn once, and every weather is shaded from them. Nothing here simulates: sensors
look at the recorded Timeline.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from carlaloc_env.core.clock import STEP_NS, TICK_NS
from carlaloc_env.rigs.rig import Rig, SensorRig
from carlaloc_env.samples import Sample
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.base import Camera
from carlaloc_env.sensors.ground_truth.ego_truth import truth_at
from carlaloc_env.sensors.ground_truth.objects import objects_at
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.town.build import load_town
from carlaloc_env.town.parked import without_parked_cars
from carlaloc_env.weather.schedule import Weather
from recorder.episode.episode import Episode
from recorder.episode.traffic_level import TrafficLevel
from recorder.generation.replay_plan import ReplayConfig, rig_of
from recorder.generation.sequence_writers import DatasetSequence, sequence_writers, without_unwritten


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelJob:
    """One traffic level of a replay, as a worker gets it."""

    config: ReplayConfig
    town: Path
    """OpenDRIVE file of the town."""
    level: TrafficLevel
    sequences: tuple[DatasetSequence, ...]
    span_ns: tuple[int, int]
    camera_ns: tuple[int, int]
    seed: int


def replay_level(job: LevelJob, report: Callable[[float], None]) -> None:
    """Write all sequences of one traffic level.

    Args:
        job: What to write.
        report: Told after every step how many seconds of the stretch are done.

    Raises:
        WriterError: the disk is full.
        RenderError: pictures cannot be drawn here.
        RaycastError: rays cannot be cast here.
    """
    episode = Episode.load(job.config.episode)
    timeline = job.level.select(episode.timeline())
    config = without_unwritten(rig_of(job.config), job.config.formats, job.config.topics)
    # Nobody else holds the town here, so that the stage can let its meshes go.
    stage = SensorStage(
        load_town(job.town) if job.level.parked_cars else without_parked_cars(load_town(job.town)),
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
            report((window[1] - first) / 1e9)
        for group in writers:
            group.close()
    except BaseException:
        for group in writers:
            group.abort()
        raise
    finally:
        stage.close()


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
