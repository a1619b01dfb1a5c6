"""Options and plan of a replay, checked before anything heavy is imported, built or written.

Size and time of a replay, estimated before it begins.
"""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.cores import usable_cores
from carlaloc_env.core.errors import ConfigError, WriterError
from carlaloc_env.core.files.output_paths import check_output_folder
from carlaloc_env.faults.faults import Faults
from carlaloc_env.map.sources import TownId
from carlaloc_env.render.views import check_quality
from carlaloc_env.rigs.memory import check_memory
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import Events, Image, PointCloud
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.timeline.timeline import Timeline
from recorder.dataset.layout import FORMATS, DatasetFolder, DriveFolder, SequenceFolder, check_formats
from recorder.dataset.manifest import drive_origin, has_drive
from recorder.episode.episode import Episode
from recorder.episode.episode_town import check_kept_town, town_id_of
from recorder.replaying.conditions import Recipe, Unit, code_digest, conditions_of, units_of
from recorder.writers.stream_sizes import element_bytes, large_streams, pixels_hz
from recorder.writers.topic_profiles import profile_by_name


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayOptions:
    """Conditions, sensors and formats of a replay."""

    weathers: tuple[str, ...] = ("ClearNoon",)
    """Names of weathers, or paths of schedules (``.yaml``)."""
    traffic: tuple[str, ...] = ("dynamic",)
    """Traffic levels: ``dynamic``, ``static``, ``empty``, fractions."""
    rig: str = "paper"
    """Name of a rig, or a YAML file."""
    formats: tuple[str, ...] = ("rosbag1", "euroc")
    """Dataset formats."""
    topics: str = "standard"
    """Topic profile of bags."""
    seed: int | None = None
    """Seed of sensor noise; None: the episode's."""
    quality: str = "medium"
    """Quality of images: ``low``, ``medium``, ``high``."""
    workers: int | None = None
    """Processes; None: one per core."""
    cluster: str | None = None
    """Address of a Dask scheduler whose workers do the work in place of processes of this machine."""
    unit_s: float = 10.0
    """Length of the stretch that a worker makes at a time [s]; no byte depends on it."""
    preview: bool = True
    """Whether a film of each sequence is made."""
    lens_drops: bool = False
    """Whether drops cling to the lenses of all cameras while it rains."""
    leaf_wind_mps: float = 0.0
    """Wind that sways leaves in all images [m/s]; 0: as in the rig."""
    lidar_weather: bool = False
    """Whether fog, rain and spray reach the LiDARs; False: as in the rig."""
    faults: Faults = field(default_factory=Faults)
    """Faults of the sensors, which take the place of the rig's."""

    def __post_init__(self) -> None:
        check_formats(self.formats)
        check_quality(self.quality)
        profile_by_name(self.topics)
        made = sorted({"kitti", "dsec", "nuscenes", "colmap"} & set(self.formats))
        if self.faults.calibration and made:
            raise ConfigError(
                f"{made[0]} computes with the calibration, which has faults here; take a rosbag"
            )
        if self.workers is not None and self.workers < 1:
            raise ConfigError(f"{self.workers} workers; give at least 1")
        if self.unit_s < STEP_NS / 1e9:
            raise ConfigError(f"units of {self.unit_s:g} s; give at least {STEP_NS / 1e9:g} s")
        if self.seed is not None and self.seed < 0:
            raise ConfigError(f"seed {self.seed}; give a number that is not negative")


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayConfig(ReplayOptions):
    """A replay: the drive, its stretch, the output folder and the options."""

    episode: Path
    """Episode to replay."""
    out: Path
    """Folder of the dataset; must not hold these sequences yet."""
    start_s: float = 0.0
    """Beginning of the stretch [s]."""
    duration_s: float | None = None
    """Length of the stretch [s]; None: to the end of the drive."""
    camera_start_s: float | None = None
    """Beginning of the images [s]; None: that of the stretch."""
    camera_duration_s: float | None = None
    """Length of the images [s]; None: the whole stretch."""
    map: Path | str | None = None
    """Map of the drive, name or file; None: the town that the episode names."""

    def __post_init__(self) -> None:
        # Without arguments, `super` does not find the class that slots have recreated.
        super(ReplayConfig, self).__post_init__()
        if self.start_s < 0 or (self.duration_s is not None and self.duration_s <= 0):
            raise ConfigError("start must not be negative and duration must be above zero")


SIZE_ERROR, TIME_FACTOR = 0.3, 2
"""Largest error of an estimated size, as a part of it, and the factor within which the time is right."""
OTHER_BYTES_S = 1e6
"""Size of a second of everything else in a format [bytes]."""
START_S, LEVEL_S, RAY_S, DRAW_S, SHADE_S, BYTE_S = 25.0, 0.3, 1e-6, 50e-9, 80e-9, 4e-9
"""CPU time of a process until it works, a second, a ray, a pixel, its light in a weather, a byte [s];
fitted to the totals of docs/performance.md and docs/formats.md."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayCost:
    """Disk and time that a replay takes, estimated by rig, topics, formats, conditions, length and cores."""

    written_bytes: float
    """Size of all sequences."""
    spooled_bytes: float
    """Size of the spools beside them, which are deleted in the end."""
    seconds: float
    """Time of a machine that has built the town before [s]."""
    processes: int
    """Processes that share the work."""

    def check(self, out: Path, *, kept_bytes: int = 0) -> None:
        """Refuse a replay that the disk cannot hold, even if the estimate is too large by all its error.

        Args:
            out: Folder of the dataset.
            kept_bytes: Size of what an earlier run has left there.

        Raises:
            WriterError: it does not fit.
        """
        needed = self.written_bytes + self.spooled_bytes
        free = shutil.disk_usage(existing_folder(out)).free
        if (1.0 - SIZE_ERROR) * needed > free + kept_bytes:
            raise WriterError(
                f"needs about {needed / 1e9:.1f} GB (±{SIZE_ERROR:.0%}), and {free / 1e9:.1f} GB are free in "
                f"{out}; make room, or choose a shorter stretch, fewer conditions, --topics slam or compact"
            )

    def __str__(self) -> str:
        time = f"{self.seconds / 60:.0f} min" if self.seconds > 90 else f"{self.seconds:.0f} s"
        return (
            f"about {self.written_bytes / 1e9:.2f} GB and at times {self.spooled_bytes / 1e9:.2f} GB more "
            f"(±{SIZE_ERROR:.0%}); about {time} with {self.processes} processes (a factor of {TIME_FACTOR})"
        )


def existing_folder(folder: Path) -> Path:
    """The folder, or the nearest above it that exists."""
    return next(path for path in (folder.absolute(), *folder.absolute().parents) if path.exists())


def size_of(folder: Path) -> int:
    """Size of all files below a folder [bytes]."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def replay_cost(
    options: ReplayOptions, lengths_s: Sequence[tuple[float, float]], processes: int
) -> ReplayCost:
    """Disk and time that replays of some drives take.

    Args:
        options: Conditions, rig, topics and formats.
        lengths_s: Length of each drive's stretch and of its images [s].
        processes: Processes that share the work.
    """
    rig = without_unwritten(rig_of(options), options.formats, options.topics)
    levels, weathers = len(options.traffic), len(options.weathers)
    whole_s, images_s = (sum(lengths) for lengths in zip(*lengths_s, strict=True))
    longest = max(lengths_s)
    written = levels * weathers * whole_s * OTHER_BYTES_S * len(options.formats)
    spooled = 0.0
    streams = [stream for _, stream, _ in large_streams(rig)]
    for kind, stream, elements_hz in large_streams(rig):
        of_cloud = kind is PointCloud
        for name in options.formats:
            whole, packed = element_bytes(options.topics, name, kind, stream, streams)
            written += levels * weathers * (whole_s if of_cloud else images_s) * elements_hz * packed
            times = weathers if kind in (Image, Events) else 1
            spooled += times * longest[0 if of_cloud else 1] * elements_hz * whole
    radars: list[Any] = list(rig.of_kind("radar"))
    rays_hz = sum(s.rays * s.rate_hz for s in rig.sensors if isinstance(s, LidarConfig))
    rays_hz += sum(s.columns * s.rows * s.rate_hz for s in radars)
    all_pixels_hz = sum(pixels_hz(s) for s in rig.sensors if isinstance(s, CameraConfig))
    cpu_s = levels * (
        whole_s * (LEVEL_S + rays_hz * RAY_S) + images_s * all_pixels_hz * (DRAW_S + weathers * SHADE_S)
    )
    seconds = START_S + (cpu_s + written * BYTE_S) / max(1.0, 0.75 * processes)
    return ReplayCost(written_bytes=written, spooled_bytes=spooled, seconds=seconds, processes=processes)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReplayPlan:
    """A replay that may begin."""

    config: ReplayConfig
    """The request."""
    recipe: Recipe
    """The sequences to make."""
    rig: SensorRig
    """All sensors, those without a format included: calibration and truth cover them, too."""
    timeline: Timeline
    """Where everything was."""
    town: TownId
    """Where it was driven."""
    span_ns: tuple[int, int]
    """First stamp and end (not included) of the stretch [ns]."""
    origin: dict[str, Any]
    """Description that all sequences of the drive share."""

    @property
    def drive(self) -> DriveFolder:
        """Folder of the drive in the dataset."""
        return DatasetFolder(self.config.out).drive(self.town.name)

    @property
    def sequences(self) -> tuple[SequenceFolder, ...]:
        """Folders of the sequences in the dataset."""
        return tuple(self.drive.sequence(condition.name) for condition in self.recipe.conditions)

    @property
    def processes(self) -> int:
        """How many processes of this machine can share the work."""
        return min(self.config.workers or len(usable_cores()), len(self.units))

    @property
    def units(self) -> tuple[Unit, ...]:
        """Units of work, traffic level by traffic level."""
        unit_ns = round(self.config.unit_s * 1e9) // STEP_NS * STEP_NS
        return units_of(self.recipe.levels, self.span_ns, unit_ns)

    def cost(self, later_s: Sequence[float] = ()) -> ReplayCost:
        """Disk and time that the replay takes, and further drives of these lengths [s]."""
        lengths_s = [(end - first) / 1e9 for first, end in (self.span_ns, self.recipe.camera_ns)]
        later = [(length_s, length_s) for length_s in later_s]
        return replay_cost(self.config, [(lengths_s[0], lengths_s[1]), *later], self.processes)

    @property
    def request(self) -> dict[str, str]:
        """Everything that determines the written bytes, by readable names."""
        recipe = self.recipe
        return {
            "town": f"{self.town.name} {self.town.source_hash}",
            "episode": self.origin["episode"]["sha256"],
            "rig": repr(self.rig),
            "stretch": repr((self.span_ns, recipe.camera_ns)),
            "set of conditions": repr(recipe.conditions),
            "set of formats": repr((recipe.formats, recipe.topics, recipe.preview)),
            "seed": repr(recipe.seed),
            "quality": recipe.quality,
            "length of units": repr(self.config.unit_s),
            "version of CarlaLoc": code_digest(),
        }

    def check_room(self) -> bool:
        """Whether the dataset is begun already, so that sequences are added to it.

        Raises:
            WriterError: it holds another drive, or already has a sequence of this one.
        """
        begun = has_drive(self.config.out, self.town.name, self.origin)
        if not begun and self.drive.path.exists():
            raise WriterError(
                f"{self.drive.path} exists, but {self.config.out} lists no drive there; "
                "choose another --out or delete it first"
            )
        for folder in self.sequences:
            if folder.path.exists():
                raise WriterError(f"{folder.path} exists; choose another --out or delete it first")
        return begun


def plan_replay(config: ReplayConfig) -> ReplayPlan:
    """Look at everything that a replay needs.

    Raises:
        ConfigError: an unknown rig, weather or level, or a stretch outside the drive.
        EpisodeError: the episode cannot be read, or its map has changed since or must be given.
        OutputError: `out` is no folder.
        WriterError: `out` holds another dataset.
    """
    check_output_folder(config.out)
    rig = rig_of(config)
    faults = config.faults.over(rig.faults)
    faults.check(rig.sensors)
    rig = replace(rig, faults=Faults())
    conditions = conditions_of(config.weathers, config.traffic, faults)
    episode = Episode.load(config.episode)
    timeline = episode.timeline()
    span, cameras = _spans(config, timeline)
    town = town_id_of(episode, config.map)
    seed = episode.header.seed if config.seed is None else config.seed
    recipe = Recipe(
        episode=config.episode.resolve(),
        town=town.source.resolve(),
        conditions=conditions,
        rig=without_unwritten(rig, config.formats, config.topics),
        camera_ns=cameras,
        seed=seed,
        quality=config.quality,
        formats=config.formats,
        topics=config.topics,
        preview=config.preview,
    )
    plan = ReplayPlan(
        config=config,
        recipe=recipe,
        rig=rig,
        timeline=timeline,
        town=town,
        span_ns=span,
        origin=drive_origin(episode, rig.believed(faults), seed=seed, span_ns=span, topics=config.topics),
    )
    if config.cluster is None:
        weathers = len(conditions) // len(recipe.levels)
        check_memory(rig, quality=config.quality, weathers=weathers, processes=plan.processes)
    # Last, since it imports what builds towns.
    check_kept_town(episode, town)
    return plan


def rig_of(config: ReplayOptions) -> SensorRig:
    """The rig of a replay, with the options that it sets for all cameras.

    Raises:
        ConfigError: there is no such rig, or an option is out of range.
    """
    rig = rig_by_name(config.rig)
    if config.lidar_weather:
        lidars = {s: replace(s, weather=True) for s in rig.sensors if isinstance(s, LidarConfig)}
        rig = replace(rig, sensors=tuple(lidars.get(s, s) for s in rig.sensors))  # type: ignore[call-overload]
    changes: dict[str, Any] = {}
    if config.lens_drops:
        changes["lens_drops"] = True
    if config.leaf_wind_mps:
        changes["leaf_wind_mps"] = config.leaf_wind_mps
    if not changes:
        return rig
    sensors = tuple(replace(s, **changes) if isinstance(s, CameraConfig) else s for s in rig.sensors)
    return replace(rig, sensors=sensors)


def without_unwritten(rig: SensorRig, formats: Sequence[str], topics: str) -> SensorRig:
    """The rig without event cameras if no format holds events: they cost more than all else.

    Args:
        rig: The sensors.
        formats: Names of dataset formats.
        topics: Topic profile of bags.
    """
    in_bags = any(rule.sample is Events for rule in profile_by_name(topics).rules)
    if {"dsec", "raw"} & set(formats) or (in_bags and any(FORMATS[name].is_bag for name in formats)):
        return rig
    sensors = tuple(
        replace(config, outputs=tuple(output for output in config.outputs if output != "events"))
        if isinstance(config, CameraConfig) and set(config.outputs) - {"events"}
        else config
        for config in rig.sensors
    )
    return replace(rig, sensors=sensors)


def _spans(config: ReplayConfig, timeline: Timeline) -> tuple[tuple[int, int], tuple[int, int]]:
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
    if begin >= end:
        raise ConfigError(
            f"the images begin at {begin / 1e9:g} s, but the stretch ends at {end / 1e9:g} s; "
            "give a smaller --camera-start"
        )
    if length <= first:
        raise ConfigError(
            f"the images end at {length / 1e9:g} s, but the stretch begins at {first / 1e9:g} s; "
            "give a larger --camera-start or --camera-duration"
        )
    return (first, end), (max(begin, first), min(length, end))
