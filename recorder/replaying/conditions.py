"""The conditions of a replay, and the units of work that it is cut into.

The conditions of a replay: weather, traffic and faults.

The input of workers: the recipe of a drive's sequences, and units, the stretches that they make.

A unit needs only the episode. No byte of a dataset depends on the length of units.

A condition as a file: weather, traffic, faults, stretch and seed, as commands take it back.

Digest of all code that makes a dataset: a run resumes only work of the same code.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml

import carlaloc_env
import recorder
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.errors import ConfigError, check_name
from carlaloc_env.core.files.config_files import from_mapping
from carlaloc_env.core.files.text_files import read_text
from carlaloc_env.faults.faults import Faults
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.weather.presets import weather_word
from carlaloc_env.weather.schedule import Weather, weather_of
from recorder.dataset.manifest import VERSIONED
from recorder.episode.traffic_level import TrafficLevel, traffic_level


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """One sequence of a dataset: a weather and a traffic level."""

    weather_name: str
    """Name of the weather, part of the folder's name."""
    weather: Weather
    """Parameters of the weather, or a schedule."""
    traffic: TrafficLevel
    """Fraction of the traffic."""
    faults: Faults = field(default_factory=Faults)
    """Faults of the sensors; those of the calibration are the same in all conditions of a dataset."""

    def __post_init__(self) -> None:
        check_name("weather", self.weather_name)
        check_name("traffic level", self.traffic.name)

    @property
    def name(self) -> str:
        """Folder of the sequence, e.g. ``ClearNoon_dynamic``."""
        return "_".join(filter(None, (self.weather_name, self.traffic.name, self.faults.slug)))


def conditions_of(
    weathers: Sequence[str], levels: Sequence[str], faults: Faults | None = None
) -> tuple[Condition, ...]:
    """All combinations, weather by weather within each traffic level, with the same faults in all.

    Raises:
        ConfigError: an unknown weather or level, or none at all.
    """
    if not weathers or not levels:
        raise ConfigError("a replay needs at least one weather and one traffic level")
    return tuple(
        Condition(
            weather_name=weather_word(name),
            weather=weather_of(name),
            traffic=level,
            faults=faults or Faults(),
        )
        for level in dict.fromkeys(traffic_level(text) for text in levels)
        for name in dict.fromkeys(weathers)
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Recipe:
    """All sequences to make of a drive."""

    episode: Path
    """The drive, absolute path."""
    town: Path
    """OpenDRIVE file of its town, absolute path."""
    conditions: tuple[Condition, ...]
    """Weather and traffic of each sequence."""
    rig: SensorRig
    """Sensors whose samples a format holds."""
    camera_ns: tuple[int, int]
    """First stamp of images and end (not included) [ns]."""
    seed: int
    """Seed of sensor noise."""
    quality: str
    """Quality of images."""
    formats: tuple[str, ...]
    """Names of dataset formats."""
    topics: str
    """Topic profile of bags."""
    preview: bool
    """Whether a film of each sequence is made."""

    @property
    def levels(self) -> tuple[TrafficLevel, ...]:
        """Traffic levels, each once."""
        return tuple(dict.fromkeys(condition.traffic for condition in self.conditions))

    @property
    def believed(self) -> SensorRig:
        """The rig as calibration shows it: the true one, unless the calibration has faults."""
        return self.rig.believed(self.conditions[0].faults) if self.conditions else self.rig

    def conditions_of(self, level: TrafficLevel) -> tuple[Condition, ...]:
        """Conditions of a traffic level: its weathers."""
        return tuple(condition for condition in self.conditions if condition.traffic == level)


@dataclass(frozen=True, slots=True, kw_only=True)
class Unit:
    """A stretch of a drive under a traffic level."""

    level: TrafficLevel
    """Traffic."""
    span_ns: tuple[int, int]
    """First stamp and end (not included) [ns]."""

    @property
    def name(self) -> str:
        """Name of its folder: level and beginning [ms]."""
        return f"{self.level.name}-{self.span_ns[0] // 1_000_000:09d}"

    @property
    def length_s(self) -> float:
        """Length of the stretch [s]."""
        return (self.span_ns[1] - self.span_ns[0]) / 1e9


def units_of(levels: Sequence[TrafficLevel], span_ns: tuple[int, int], unit_ns: int) -> tuple[Unit, ...]:
    """Units of a stretch, level by level, in the order of time.

    Borders lie one step after multiples of the length: event cameras restart at such multiples, and the
    first picture after one needs nothing older.

    Args:
        levels: Traffic levels.
        span_ns: First stamp and end of the stretch [ns].
        unit_ns: Length of a unit [ns], a multiple of 50 ms.
    """
    first, end = span_ns
    borders = [first, *range((first // unit_ns + 1) * unit_ns + STEP_NS, end, unit_ns), end]
    return tuple(
        Unit(level=level, span_ns=(begin, until)) for level in levels for begin, until in pairwise(borders)
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ConditionFile:
    """The values of such a file; the command gives those that it leaves out."""

    weather: str = "ClearNoon"
    """Name of a weather with its changes, or path of a schedule."""
    traffic: str = "dynamic"
    """Traffic level."""
    lidar_weather: bool = False
    """Whether the weather reaches the LiDARs."""
    faults: dict[str, Any] = field(default_factory=dict)
    """Faults by sensor."""
    start_s: float | None = None
    """Beginning of the stretch [s]; None: the command's."""
    duration_s: float | None = None
    """Length of the stretch [s]; None: the command's."""
    seed: int | None = None
    """Seed of the noise; None: the command's."""

    @classmethod
    def read(cls, path: Path) -> ConditionFile:
        """The condition of a YAML file.

        Raises:
            ConfigError: the file is missing or no YAML, or a key or value is not valid.
        """
        try:
            document = yaml.safe_load(read_text(path, "condition"))
        except yaml.YAMLError as error:
            raise ConfigError(f"{path}: not valid YAML: {' '.join(str(error).split())}") from error
        if isinstance(document, dict) and "traffic" in document:
            document["traffic"] = str(document["traffic"])
        found = from_mapping(cls, document, path.name)
        weather_of(found.weather)
        traffic_level(found.traffic)
        Faults.from_mapping(found.faults, f"{path.name}: faults")
        return found

    @property
    def fault_words(self) -> list[str]:
        """Faults as `--fault` takes them."""
        return Faults.from_mapping(self.faults).label.split()

    def to_yaml(self) -> str:
        """Text of the file, without keys at their empty values."""
        values = {name: getattr(self, name) for name in self.__slots__}
        text: str = yaml.safe_dump(
            {name: value for name, value in values.items() if value not in (None, {})}, sort_keys=False
        )
        return text


_SUFFIXES = (".py", ".glsl", ".vert", ".frag", ".jinja")


@functools.cache
def code_digest() -> str:
    """SHA-256 of the sources of both packages and of the versions of libraries that shape a dataset."""
    digest = hashlib.sha256()
    for package in (carlaloc_env, recorder):
        folder = Path(str(package.__file__)).parent
        for path in sorted(path for path in folder.rglob("*") if path.suffix in _SUFFIXES):
            digest.update(f"{path.relative_to(folder)}\n".encode())
            digest.update(path.read_bytes())
    for name in VERSIONED:
        digest.update(f"{name} {version(name)}\n".encode())
    return digest.hexdigest()
