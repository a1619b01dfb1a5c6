"""The sensors of a drive under one traffic level: built once in a process, they measure any stretch of it.

Rays are cast and G-buffers drawn once, and every weather is shaded from them. Nothing here simulates: sensors
look at the recorded Timeline.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from heapq import merge

import numpy as np

from carlaloc_env.core.clock import STEP_NS, TICK_NS
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import Sample
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.base import Camera
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.ground_truth import objects_at, truth_at
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.town.town import without_movables
from recorder.episode.episode import Episode
from recorder.episode.episode_town import town_of
from recorder.episode.traffic_level import TrafficLevel
from recorder.replaying.camera_history import first_pictures_ns
from recorder.replaying.recipe import Recipe
from recorder.replaying.roadside import timeline_of
from recorder.replaying.spool import Order


@dataclass(frozen=True, slots=True)
class Measured:
    """A sample, its order and its condition."""

    order: Order
    """Its place among all samples."""
    weather: int | None
    """Number of its condition, weather and faults; None: the same under all of them."""
    sample: Sample
    """The sample."""


class LevelSensors:
    """Sensors on the stage of a level.

    Args:
        recipe: Sequences to make of the drive.
        level: The traffic level.
        truth: Whether they measure the truth of the ego and of all objects, too.

    Raises:
        EpisodeError: the drive was in another town.
        RenderError: pictures cannot be drawn here.
        RaycastError: rays cannot be cast here.
    """

    def __init__(self, recipe: Recipe, level: TrafficLevel, *, truth: bool = True) -> None:
        self.recipe, self.level, self._has_truth = recipe, level, truth
        conditions = recipe.conditions_of(level)
        self._faults = [condition.faults for condition in conditions]
        # Conditions that differ in faults alone share all that is measured.
        self._weathers = list(dict.fromkeys(condition.weather for condition in conditions))
        self._weather_of = [self._weathers.index(condition.weather) for condition in conditions]
        episode = Episode.load(recipe.episode, car=recipe.car)
        self._timeline = level.select(timeline_of(episode, recipe.roadside))
        # No other reference to the town remains, so that the stage can release its meshes.
        self._stage = SensorStage(
            town_of(episode, recipe.town)
            if level.parked_cars
            else without_movables(town_of(episode, recipe.town)),
            seed=recipe.seed,
            weather=self._weathers[0],
            quality=recipe.quality,
            ego_body=recipe.roadside is None,
        )
        self._rig = recipe.rig.build(self._stage)
        self._objects = _object_truth(recipe.rig, self._stage) if truth else objects_at

    @property
    def streams(self) -> tuple[str, ...]:
        """Names of all streams of the rig."""
        return self._rig.streams

    def close(self) -> None:
        """Release GPU memory."""
        self._stage.close()

    def recall(self, span_ns: tuple[int, int]) -> Iterator[int]:
        """Stamps of the pictures that cameras must have seen before a stretch [ns], each seen in its turn.

        `measure` catches up on missing ones; this reports the progress.
        """
        timeline, weathers = self._timeline, self._weathers
        firsts_ns = first_pictures_ns(self.recipe.rig, self.recipe.camera_ns, span_ns)
        # All cameras advance together: they share shadows.
        return merge(
            *(
                sensor.recall(timeline, firsts_ns[config], weathers)
                for config, sensor in zip(self.recipe.rig.sensors, self._rig.sensors, strict=True)
                if isinstance(config, CameraConfig) and isinstance(sensor, Camera) and config in firsts_ns
            )
        )

    def measure(self, window_ns: tuple[int, int]) -> list[Measured]:
        """Samples with stamps in a window [ns], begin included, in their order."""
        samples = [sample for versions in self._of_sensors(window_ns) for sample in self._faulty(*versions)]
        if self._has_truth:
            samples += self._truth(window_ns)
        return sorted(samples, key=lambda measured: measured.order)

    def reseed(self, seed: int) -> None:
        """Measure with the noise of another seed from now on."""
        self._stage.seed = seed

    def _of_sensors(self, window_ns: tuple[int, int]) -> Iterator[tuple[Order, list[Sample]]]:
        """Places of samples, and the samples under all weathers; a single sample where they are the same."""
        timeline, weathers = self._timeline, self._weathers
        begin, end = self.recipe.camera_ns
        for place, sensor in enumerate(self._rig.sensors):
            stamps = [
                stamp
                for stamp in sensor.schedule.stamps_ns_in(*window_ns)
                if stamp + sensor.latency_ns <= timeline.end_ns
            ]
            if isinstance(sensor, Camera):
                for stamp in stamps:
                    if begin <= stamp < end:
                        rows = sensor.measure_conditions(timeline, stamp, weathers)
                        yield from _by_weather(stamp, place, rows)
            elif sensor.depends_on_weather:
                for stamp in stamps:
                    now = [weather.at(stamp) for weather in weathers]
                    yield from _by_weather(stamp, place, sensor.measure_conditions(timeline, stamp, now))
            else:
                for number, sample in enumerate(sensor.measure(timeline, stamps)):
                    yield (sample.stamp_ns, place, number), [sample]

    def _faulty(self, order: Order, versions: list[Sample]) -> Iterator[Measured]:
        """A sample as the faults of all conditions leave it, once where it is the same in all of them."""
        config = self.recipe.rig.sensors[order[1]]
        made: dict[object, Sample | None] = {}
        samples: list[Sample | None] = []
        for weather, faults in zip(self._weather_of, self._faults, strict=True):
            key = (weather if len(versions) > 1 else 0, faults.of(config))
            if key not in made:
                made[key] = faults.apply(versions[key[0]], config, self._stage.seed)
            samples.append(made[key])
        if len(made) == 1:
            if samples[0] is not None:
                yield Measured(order, None, samples[0])
            return
        yield from (Measured(order, k, sample) for k, sample in enumerate(samples) if sample is not None)

    def _truth(self, window_ns: tuple[int, int]) -> Iterator[Measured]:
        first, end = window_ns
        for stamp in range(-(-first // STEP_NS) * STEP_NS, end, STEP_NS):
            yield Measured((stamp, -1, 0), None, self._objects(self._timeline, stamp))
        ticks = np.arange(first, end, TICK_NS)
        for truth in truth_at(self._timeline, ticks.tolist(), np.eye(4)):
            yield Measured((truth.stamp_ns, -1, 1), None, truth)


def _by_weather(stamp_ns: int, place: int, rows: list[list[Sample]]) -> Iterator[tuple[Order, list[Sample]]]:
    """Samples of a sensor at an instant; once where all weathers have the same."""
    for number, versions in enumerate(zip(*rows, strict=True)):
        is_same = all(version is versions[0] for version in versions)
        yield (stamp_ns, place, number), list(versions[:1] if is_same else versions)


def _object_truth(config: SensorRig, stage: SensorStage) -> Callable[[Timeline, int], Sample]:
    """Truth of all actors; rigs without rays do without visibility, so that they need no Open3D."""
    eyes = [sensor.mount.position_m for kind in ("lidar", "radar") for sensor in config.of_kind(kind)]
    if not eyes:
        return objects_at
    return partial(objects_at, rays=stage.rays(), eye_m=eyes[0])
