"""A drive that is read while it is made, and the folder that describes it like a dataset.

The folder has calibration, truth and descriptions, a few megabytes, and no sensor data.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from carlaloc_env.core.errors import ConfigError, EvaluationError, WriterError
from carlaloc_env.core.files.atomic_files import write_whole
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.weather.presets import weather_word
from recorder.dataset.layout import SequenceFolder
from recorder.dataset.manifest import SequenceDescription, drive_origin, has_drive, list_drive
from recorder.dataset.rig_sensors import imu_of, with_lidar_first
from recorder.episode.episode import Episode
from recorder.episode.traffic_level import traffic_level
from recorder.replaying.conditions import Condition
from recorder.replaying.options import ReplayConfig, ReplayOptions
from recorder.replaying.plan import ReplayPlan, plan_replay
from recorder.replaying.sequence_writers import describe, write_shared
from recorder.streaming.frames import FrameJob, sensors_for


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveStream:
    """A drive under a condition, with the noise of a seed."""

    plan: ReplayPlan
    """The drive; its rig has what SLAM systems read."""
    condition: Condition
    """Weather and traffic."""

    @property
    def folder(self) -> SequenceFolder:
        """Folder that describes it."""
        return self.plan.drive.sequence(self.condition.name)

    @property
    def seed(self) -> int:
        """Seed of its noise."""
        return self.plan.recipe.seed

    @property
    def digest(self) -> str:
        """Digest of everything that determines the sensor data."""
        request = self.plan.request
        about = [request[name] for name in sorted(request) if not name.startswith(("set of", "length of"))]
        return hashlib.sha256("\n".join([*about, repr(self.condition)]).encode()).hexdigest()

    def frame_job(self, sensor: str, *, masks: bool) -> FrameJob:
        """The job that makes its frames; seeds may be added."""
        plan = self.plan
        imus = plan.rig.of_kind("imu")
        return FrameJob(
            recipe=replace(plan.recipe, rig=sensors_for(plan.rig, sensor, masks=masks)),
            level=self.condition.traffic,
            span_ns=plan.span_ns,
            seeds=(self.seed,),
            sensor=sensor,
            imu=imu_of(plan.rig) if imus else None,
        )

    def alone(self, out: Path, *, sensor: str) -> ReplayConfig:
        """The replay of this condition into a dataset, with the sensors of a kind.

        Args:
            out: Folder of the dataset; the rig's file is written beside it.
            sensor: ``lidar`` or ``stereo``.
        """
        config, condition = self.plan.config, self.condition
        rig = sensors_for(self.plan.rig, sensor)
        file = out.with_name("rig.yaml")
        imus = self.plan.rig.of_kind("imu")
        file.write_text(replace(rig, sensors=(*imus, *rig.sensors)).to_yaml(), encoding="utf-8")
        return replace(
            config,
            out=out,
            rig=str(file),
            faults=condition.faults.only((*imus, *rig.sensors)),
            weathers=tuple(name for name in config.weathers if weather_word(name) == condition.weather_name),
            traffic=tuple(text for text in config.traffic if traffic_level(text) == condition.traffic)[:1],
            formats=("rosbag1",) if sensor == "lidar" else ("rosbag1", "euroc"),
            seed=self.seed,
            preview=False,
            workers=None,
        )

    def write_movers(self, shares: Mapping[str, float]) -> None:
        """Write the shares of movers of some streams, which are the same in all weathers."""
        plan = self.plan
        for condition in plan.recipe.conditions_of(self.condition.traffic):
            folder = plan.drive.sequence(condition.name)
            movers = SequenceDescription.read(folder).movers
            _describe(plan, condition, folder.description, {**movers, **shares})
        list_drive(plan.config.out, plan.town.name, plan.origin)


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveConfig:
    """Drives that are read while they are made, and their conditions."""

    episodes: tuple[Path, ...]
    """Drives."""
    options: ReplayOptions
    """Conditions, rig, quality; formats and workers are ignored."""
    noise_seeds: int = 1
    """Number of seeds of noise, from that of the options on."""
    start_s: float = 0.0
    """Beginning of the stretch [s]."""
    duration_s: float | None = None
    """Length of the stretch [s]; None: to the end of the drive."""
    map: Path | str | None = None
    """Map of the drives, name or file; None: the towns that the episodes name."""
    lidar: str | None = None
    """Name of the LiDAR; None: the rig's first."""

    def __post_init__(self) -> None:
        names = [path.stem for path in self.episodes]
        for name in names:
            if names.count(name) > 1:
                raise ConfigError(f"two drives are called {name}; rename one")


def describe_drives(config: DriveConfig, out: Path) -> list[DriveStream]:
    """Streams of all drives, seeds and conditions, described in folders ``DRIVE/seed<S>`` of `out`.

    Raises:
        ConfigError: an unknown rig, weather or level, or a stretch outside a drive.
        EpisodeError: an episode cannot be read, or its map has changed since.
        EvaluationError: the rig has nothing that a SLAM system reads.
        WriterError: a folder describes another drive, rig or stretch.
    """
    streams = []
    for episode in config.episodes:
        first = config.options.first_seed(episode)
        for seed in range(first, first + config.noise_seeds):
            replayed = config.options.of_drive(
                seed=seed,
                workers=1,
                episode=episode,
                out=out / episode.stem / "_".join(filter(None, (f"seed{seed}", config.lidar))),
                start_s=config.start_s,
                duration_s=config.duration_s,
                map=config.map,
            )
            streams += describe_drive(replayed, lidar=config.lidar)
    return streams


def describe_drive(
    config: ReplayConfig, conditions: tuple[Condition, ...] | None = None, *, lidar: str | None = None
) -> list[DriveStream]:
    """Streams of a drive under all conditions of a replay, described in its folder `out`.

    Args:
        config: The replay; its faults of calibration are those of all conditions.
        conditions: Conditions; None: those of the replay.
        lidar: Name of the LiDAR; None: the rig's first.

    Raises:
        ConfigError: an unknown rig, weather or level, or a stretch outside the drive.
        EpisodeError: the episode cannot be read, or its map has changed since or must be given.
        WriterError: the folder describes another drive, rig or stretch.
    """
    asked = plan_replay(config)
    rig = _slam_rig(with_lidar_first(asked.rig, lidar))
    recipe = asked.recipe if conditions is None else replace(asked.recipe, conditions=conditions)
    faults = recipe.conditions[0].faults
    origin = drive_origin(
        Episode.load(config.episode, car=config.car), rig.believed(faults),
        seed=recipe.seed, span_ns=asked.span_ns, topics=recipe.topics,
    )  # fmt: skip
    plan = replace(asked, rig=rig, recipe=replace(recipe, rig=rig), origin=origin)
    streams = [DriveStream(plan=plan, condition=condition) for condition in recipe.conditions]
    if not has_drive(config.out, plan.town.name, origin):
        # The remains of an interrupted command are not whole.
        shutil.rmtree(plan.drive.path, ignore_errors=True)
        write_shared(
            plan.drive, rig, plan.timeline, plan.span_ns,
            topics=recipe.topics, seed=recipe.seed, faults=faults,
        )  # fmt: skip
    missing = [stream for stream in streams if not stream.folder.description.exists()]
    for stream in missing:
        _describe(plan, stream.condition, stream.folder.description, {})
    if missing:
        list_drive(config.out, plan.town.name, origin)
    return streams


def _describe(plan: ReplayPlan, condition: Condition, file: Path, movers: Mapping[str, float]) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    description = describe(condition, rig=plan.rig, samples={}, movers=movers)
    write_whole(file, description.to_yaml(), WriterError)


def _slam_rig(rig: SensorRig) -> SensorRig:
    """The sensors of a rig that SLAM systems read: IMU, LiDAR, and a pair of cameras without depth.

    Raises:
        EvaluationError: there are none.
    """
    cameras = rig.of_kind("camera")[:2]
    pair = cameras if len(cameras) == 2 else ()
    kept = (*rig.of_kind("imu")[:1], *rig.of_kind("lidar")[:1], *pair)
    if all(sensor.kind == "imu" for sensor in kept):
        raise EvaluationError(f"rig '{rig.name}' has neither a LiDAR nor two cameras; choose another --rig")
    return replace(rig, sensors=kept)
