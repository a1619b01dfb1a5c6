"""Makes the frames of a drive, sweeps or stereo pairs, for all seeds and weathers that share work.

Rays are cast once for all seeds of noise, and geometry is drawn once for all weathers. The frames are
bit by bit those of a dataset of the same drive.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.clock import STEP_NS, Schedule
from carlaloc_env.faults.faults import Faults
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import Image, Imu, PointCloud, SemanticImage
from carlaloc_env.sensors.base import SensorConfig
from carlaloc_env.sensors.imu import ImuConfig, ImuSensor
from carlaloc_env.timeline.timeline import Timeline
from recorder.dataset.mover_masks import mask_of
from recorder.dataset.readings import ImuSample, StereoPair
from recorder.dataset.rig_sensors import lidar_of, stereo_of
from recorder.dataset.scans import Scan
from recorder.episode.traffic_level import TrafficLevel
from recorder.replaying.level_sensors import LevelSensors, Measured
from recorder.replaying.recipe import Recipe
from recorder.replaying.sample_counts import SampleCounts
from recorder.writers.base import DEFAULT_EPOCH_NS, grey

Masks: TypeAlias = tuple[NDArray[np.bool_], NDArray[np.bool_]]
"""Where the left and the right image show movers, each of shape (H, W)."""
Frame: TypeAlias = "Scan | tuple[StereoPair, Masks | None]"
"""A frame of a system: a sweep, or a pair of images and masks of their movers."""
Key: TypeAlias = tuple[int, int]
"""Which version of a frame: number of its condition, and seed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameJob:
    """Frames of a stretch of a drive under a traffic level."""

    recipe: Recipe
    """The drive and its conditions; its rig holds what `sensors_for` leaves."""
    level: TrafficLevel
    """Traffic; weathers are those that the recipe has with it."""
    span_ns: tuple[int, int]
    """First stamp and end (not included) [ns]."""
    seeds: tuple[int, ...]
    """Seeds of noise."""
    sensor: str
    """Sensor of a frame: ``lidar`` or ``stereo``."""
    imu: ImuConfig | None
    """The IMU beside it; None: there is none."""

    @property
    def length_s(self) -> float:
        """Length of the stretch [s]."""
        return (self.span_ns[1] - self.span_ns[0]) / 1e9

    def faults_of(self, key: Key) -> Faults:
        """Faults of the sensors in a version of the frames."""
        return self.recipe.conditions_of(self.level)[key[0]].faults


def sensors_for(rig: SensorRig, sensor: str, *, masks: bool = True) -> SensorRig:
    """A rig with only the sensors of frames.

    Args:
        rig: All sensors.
        sensor: ``lidar`` or ``stereo``.
        masks: Whether movers are to be known in images, where the cameras label them.

    Raises:
        EvaluationError: the rig has no such sensor.
    """
    if sensor == "lidar":
        return replace(rig, sensors=(lidar_of(rig),))
    wanted = ("rgb", "semantic") if masks else ("rgb",)
    cameras = tuple(
        replace(camera, outputs=tuple(output for output in camera.outputs if output in wanted))
        for camera in stereo_of(rig)
    )
    return replace(rig, sensors=cameras)


def frame_stamps_ns(job: FrameJob, end_ns: int, key: Key) -> NDArray[np.int64]:
    """Unix times of all frames that come [ns], shape (N,).

    Args:
        job: The frames.
        end_ns: End of the drive, by which a sweep must be whole [ns].
        key: Version of the frames.
    """
    rig, is_lidar = job.recipe.rig, job.sensor == "lidar"
    sensors: tuple[SensorConfig, ...] = (lidar_of(rig),) if is_lidar else stereo_of(rig)
    true = Schedule.from_hz(sensors[0].rate_hz).stamps_ns_in(*job.span_ns)
    if is_lidar:
        true = [stamp for stamp in true if stamp + lidar_of(rig).sweep_ns <= end_ns]
    faults = job.faults_of(key)
    pairs = zip(*(faults.stamps_ns(true, sensor, key[1]) for sensor in sensors), strict=True)
    stamps = [pair[0] for pair in pairs if pair[0] is not None and len(set(pair)) == 1]
    return DEFAULT_EPOCH_NS + np.array(stamps, np.int64)


def inertial_samples(job: FrameJob, timeline: Timeline, key: Key) -> list[ImuSample]:
    """All inertial samples of the stretch that come; none without an IMU.

    Args:
        job: The frames.
        timeline: The drive.
        key: Version of the frames.
    """
    if job.imu is None:
        return []
    seed, faults = key[1], job.faults_of(key)
    sensor = ImuSensor(job.imu, seed)
    stamps = [stamp for stamp in sensor.schedule.stamps_ns_in(*job.span_ns) if stamp <= timeline.end_ns]
    return [
        inertial_of(sample)
        for true in sensor.measure(timeline, stamps)
        if isinstance(sample := faults.apply(true, job.imu, seed), Imu)
    ]


def inertial_of(sample: Imu) -> ImuSample:
    """A sample of an IMU as systems read it."""
    return ImuSample(
        stamp_ns=DEFAULT_EPOCH_NS + sample.stamp_ns,
        acceleration_mps2=sample.specific_force_mps2,
        angular_velocity_radps=sample.angular_rate_radps,
    )


class FrameMaker:
    """Makes frames in the order of time.

    Args:
        job: The frames.

    Raises:
        EpisodeError: the drive was in another town.
        RenderError: pictures cannot be drawn here.
        RaycastError: rays cannot be cast here.
    """

    def __init__(self, job: FrameJob) -> None:
        self._job = job
        self._sensors = LevelSensors(job.recipe, job.level, truth=False)
        self._conditions = job.recipe.conditions_of(job.level)
        self._counts = SampleCounts()
        self.shared = (0, 0)
        """Instants that were measured so far, and frames that were made of them."""

    def frames(self) -> Iterator[tuple[float, dict[Key, Frame]]]:
        """Yield the length of the finished stretch [s] and all versions of a frame, in the order of time."""
        first, end = self._job.span_ns
        for _ in self._sensors.recall(self._job.span_ns):
            pass
        for begin in range(first, end, STEP_NS):
            versions: dict[int, dict[Key, Frame]] = {}
            for seed in self._job.seeds:
                self._sensors.reseed(seed)
                measured = self._sensors.measure((begin, min(begin + STEP_NS, end)))
                for stamp, weather, frame in self._frames(measured):
                    versions.setdefault(stamp, {})[weather, seed] = frame
            # Rays and G-buffers of an instant serve all seeds, weathers and faults.
            self.shared = self.shared[0] + len(versions), self.shared[1] + sum(map(len, versions.values()))
            for stamp in sorted(versions):
                yield (stamp - first) / 1e9, versions[stamp]

    def close(self) -> None:
        """Release GPU memory."""
        self._sensors.close()

    def mover_shares(self) -> dict[str, float]:
        """Fraction of labelled points and pixels on movers so far, 0–1, by stream."""
        return self._counts.shares()

    def _frames(self, measured: list[Measured]) -> Iterator[tuple[int, int, Frame]]:
        """True stamp, condition and frame of all that was measured in a window and is not lost."""
        by_stamp: dict[int, list[Measured]] = {}
        for measurement in measured:
            # The share of movers is that of sound sensors, where some are.
            if measurement.weather is None or not self._conditions[measurement.weather].faults:
                self._counts.count(measurement.sample)
            by_stamp.setdefault(measurement.order[0], []).append(measurement)
        frame_of: Callable[[list[Measured]], Frame | None]
        frame_of = _scan if self._job.sensor == "lidar" else self._pair
        for stamp, group in by_stamp.items():
            made: dict[tuple[int, ...], Frame | None] = {}
            for number in range(len(self._conditions)):
                mine = [measurement for measurement in group if measurement.weather in (None, number)]
                key = tuple(id(measurement.sample) for measurement in mine)
                if key not in made:
                    made[key] = frame_of(mine)
                if (frame := made[key]) is not None:
                    yield stamp, number, frame

    def _pair(self, measured: list[Measured]) -> tuple[StereoPair, Masks | None] | None:
        samples = {measurement.sample.sensor: measurement.sample for measurement in measured}
        left, right = (camera.name for camera in stereo_of(self._job.recipe.rig))
        images = [samples[f"rgb_{name}"] for name in (left, right) if f"rgb_{name}" in samples]
        if len(images) < 2 or images[0].stamp_ns != images[1].stamp_ns:
            return None
        labelled = [samples.get(f"semantic_{name}") for name in (left, right)]
        greys = [grey(image) for image in images if isinstance(image, Image)]
        pair = StereoPair(stamp_ns=DEFAULT_EPOCH_NS + images[0].stamp_ns, left=greys[0], right=greys[1])
        masks = [mask_of(image.tag) for image in labelled if isinstance(image, SemanticImage)]
        return pair, (masks[0], masks[1]) if len(masks) == 2 else None


def _scan(measured: list[Measured]) -> Scan | None:
    clouds = [measurement.sample for measurement in measured if isinstance(measurement.sample, PointCloud)]
    return scan_of(clouds) if clouds else None


def scan_of(clouds: Sequence[PointCloud]) -> Scan:
    """The streams of a sweep as bags hold it: times in single precision, labels where there are some."""
    cloud = next((cloud for cloud in clouds if cloud.tag is not None), clouds[0])
    return Scan(
        stamp_ns=DEFAULT_EPOCH_NS + cloud.stamp_ns,
        points_xyz_m=cloud.points_xyz_m.astype(np.float64),
        time_s=(cloud.offset_ns * 1e-9).astype(np.float32).astype(np.float64),
        ring=cloud.ring.astype(np.int64),
        intensity=cloud.intensity.astype(np.float64),
        tag=cloud.tag,
        doppler_mps=None if cloud.doppler_mps is None else cloud.doppler_mps.astype(np.float64),
    )
