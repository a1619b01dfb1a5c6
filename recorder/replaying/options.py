"""Options of a replay, and the rig that they give."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.core.files.config_files import set_paths
from carlaloc_env.core.own_code import absolute_word
from carlaloc_env.faults.faults import Faults
from carlaloc_env.render.views import check_quality
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import Events
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.weather.schedule import WeatherSchedule, weather_of
from recorder.dataset.layout import FORMATS, check_formats
from recorder.episode.episode import open_episode
from recorder.replaying.roadside import RoadsideUnit
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
    """Topic profile of bags: its name, or ``mine.py:PROFILE``."""
    truth_tf: bool = False
    """Whether bags have the car's true pose as the transform `/tf`, `map` → `base_link`."""
    clock: bool = False
    """Whether bags have `/clock`, which the players of bags make, too."""
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
    lidar_weather: bool = False
    """Whether fog, rain, snow and spray reach the LiDARs; False: as in the rig."""
    faults: Faults = field(default_factory=Faults)
    """Faults of the sensors, which take the place of the rig's."""

    def __post_init__(self) -> None:
        check_formats(self.formats)
        check_quality(self.quality)
        # Workers may have another folder of work.
        object.__setattr__(self, "topics", absolute_word(self.topics))
        profile_by_name(self.topics)
        made = sorted({"kitti", "dsec", "nuscenes", "opv2v", "colmap", "doppler_icp"} & set(self.formats))
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

    def first_seed(self, episode: Path) -> int:
        """Seed of sensor noise, or the first of several: the given one, else that of a drive."""
        return open_episode(episode).header.seed if self.seed is None else self.seed

    def of_drive(self, **drive: Any) -> "ReplayConfig":
        """The replay of a drive with these options; fields of `ReplayConfig` are added or replaced."""
        return ReplayConfig(**({f.name: getattr(self, f.name) for f in fields(ReplayOptions)} | drive))


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayConfig(ReplayOptions):
    """A replay: the drive, its stretch, the output folder and the options."""

    episode: Path
    """Episode to replay."""
    out: Path
    """Folder of the dataset; must not hold these sequences yet."""
    car: int = 1
    """Number of the car that carries the rig [from 1 on]."""
    roadside: RoadsideUnit | None = None
    """Fixed unit that carries the rig in place of a car [`RoadsideUnit`]."""
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
        set_paths(self, "episode", "out")
        if self.start_s < 0 or (self.duration_s is not None and self.duration_s <= 0):
            raise ConfigError("start must not be negative and duration must be above zero")

    @property
    def carrier(self) -> str:
        """Name of the car or unit that carries the rig, as its folder has it."""
        return f"car{self.car}" if self.roadside is None else self.roadside.name


def own_seed(seed: int, carrier: str) -> int:
    """Seed of a carrier's noise: a drive's own for the first car, others for the others."""
    if carrier == "car1":
        return seed
    return int.from_bytes(hashlib.blake2b(f"{seed}/{carrier}".encode(), digest_size=4).digest(), "big") >> 1


def rig_of(config: ReplayOptions) -> SensorRig:
    """The rig of a replay, with weather on the LiDARs if the replay asks for it.

    Raises:
        ConfigError: there is no such rig.
    """
    rig = rig_by_name(config.rig)
    if not config.lidar_weather:
        return rig
    lidars = {s: replace(s, weather=True) for s in rig.sensors if isinstance(s, LidarConfig)}
    return replace(rig, sensors=tuple(lidars.get(s, s) for s in rig.sensors))  # type: ignore[call-overload]


def snow_notes(config: ReplayOptions) -> list[str]:
    """A note where a weather has snow that the LiDARs of the rig do not see."""
    blind = [s.name for s in rig_of(config).sensors if isinstance(s, LidarConfig) and not s.weather]
    asked = [weather_of(w) for w in config.weathers]
    rows = [w.weathers if isinstance(w, WeatherSchedule) else (w,) for w in asked]
    if not blind or not any(w.snowfall + w.snow_cover > 0.0 for row in rows for w in row):
        return []
    sweeps = f"sweeps of {', '.join(blind)} in snow equal those of ClearNoon"
    return [f"{sweeps}; add --lidar-weather for flakes and white ground"]


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
