"""Plan of a sweep: points of axes, the drives and conditions of each, shared where they are the same.

A condition as a point of a space of quantities, and axes through it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path

import numpy as np

from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.core.files.atomic_files import write_whole
from carlaloc_env.faults.faults import Faults, fault_quantity
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.weather.presets import (
    changed_weather,
    weather_quantities,
    with_quantity,
)
from recorder.benchmark.plan import DRIVES, BenchmarkSequence, sequence_of
from recorder.dataset.checksums import file_sha256
from recorder.drive.change_traffic import change_traffic
from recorder.episode.traffic_level import LEVELS, traffic_level
from recorder.replaying.conditions import Condition
from recorder.replaying.options import rig_of
from recorder.streaming.drive import DriveConfig, describe_drive

TRAFFIC, FAULT, RIG = "traffic", "fault.", "rig."
"""Name of the factor of the traffic, and beginnings of the names of faults and of a rig's fields."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """Weather, traffic, faults, and numbers of the rig that differ."""

    weather: str = "ClearNoon"
    """A weather with its changes, or a schedule."""
    traffic: str = "dynamic"
    """A traffic level, or a factor of the recorded traffic; above 1 it is simulated anew."""
    lidar_weather: bool = False
    """Whether the weather reaches the LiDARs."""
    faults: Faults = field(default_factory=Faults)
    """Faults of the sensors."""
    rig: tuple[tuple[str, float], ...] = ()
    """Fields of the rig, as `SensorRig.with_value` takes them, and their numbers."""

    @property
    def factor(self) -> float:
        """How much of the recorded traffic there is."""
        return LEVELS[self.traffic] if self.traffic in LEVELS else float(self.traffic)

    def changed(self, name: str, value: float) -> Setting:
        """The setting with another value of a quantity.

        Raises:
            ConfigError: there is no such quantity, or it cannot have this value.
        """
        if name == TRAFFIC:
            if not 0.0 <= value < math.inf:
                raise ConfigError(f"traffic {value:g}; give a factor of 0 or more")
            return replace(self, traffic={0.0: "static", 1.0: "dynamic"}.get(value, f"{value:g}"))
        if name.startswith(FAULT):
            path = name.removeprefix(FAULT)
            fault_quantity(path)
            target, _, key = path.rpartition(".")
            faults = self.faults.to_mapping()
            faults[target] = {**faults.get(target, {}), key: value}
            return replace(self, faults=Faults.from_mapping(faults))
        if name.startswith(RIG):
            return replace(self, rig=(*self.rig, (name.removeprefix(RIG), value)))
        if name not in weather_quantities():
            names = (TRAFFIC, *weather_quantities(), "fault.lidar.time_offset_ms", "rig.lidar.rate_hz")
            raise ConfigError(unknown_name("quantity to sweep", name, names))
        base = changed_weather(self.weather)
        same = base.to_mapping().get(name) == value
        with_quantity(base, name, value)
        word = self.weather if same else f"{self.weather}:{name}={value:.6g}"
        return replace(self, weather=word, lidar_weather=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """Values of a quantity."""

    name: str
    """``traffic``, a quantity of the weather, ``fault.SENSOR.NAME``, or ``rig.SENSOR.FIELD``."""
    values: tuple[float, ...]
    """Values, rising."""
    is_log: bool = False
    """Whether they are spaced evenly in their logarithm."""

    @classmethod
    def parse(cls, word: str) -> Axis:
        """Axis of a word: ``NAME=FROM:TO:COUNT``, ``NAME=FROM:TO:logCOUNT`` or ``NAME=A,B,C``.

        Raises:
            ConfigError: the quantity is unknown, or the values are no numbers that it can have.
        """
        name, _, text = word.partition("=")
        hint = f"axis '{word}'; give NAME=FROM:TO:COUNT, e.g. fault.lidar.time_offset_ms=0:100:6"
        parts, is_log = text.split(":"), ":log" in text
        try:
            if len(parts) == 1:
                values = sorted({float(part) for part in text.split(",")})
            else:
                low, high, count = float(parts[0]), float(parts[1]), int(parts[2].removeprefix("log"))
                if count < 1 or len(parts) > 3 or (is_log and min(low, high) <= 0):
                    raise ValueError(hint)
                spaced = np.geomspace(low, high, count) if is_log else np.linspace(low, high, count)
                values = sorted({float(f"{value:.6g}") for value in spaced})
        except (ValueError, IndexError):
            raise ConfigError(hint) from None
        for value in values:
            Setting().changed(name, value)
        return cls(name=name, values=tuple(values), is_log=is_log)


EPISODES = "episodes"
"""Folder of drives among other traffic, below the sweep's folder."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepConfig:
    """Quantities of a sweep, and its drives."""

    drives: DriveConfig
    """Drives, stretch, rig and base condition: the first weather and traffic level, and the faults."""
    out: Path
    """Folder of the results."""
    axes: tuple[Axis, ...]
    """Each is swept by itself from the base condition."""
    seeds: int = 5
    """Seeds of noise; on the axis of traffic, of the traffic, too."""
    is_product: bool = False
    """Whether all combinations of the axes are run in place of each by itself."""

    def __post_init__(self) -> None:
        if not self.axes or self.seeds < 1:
            raise ConfigError("a sweep needs a quantity, e.g. --over traffic=0:1:3, and a seed")
        names = [axis.name for axis in self.axes]
        for name in names:
            if names.count(name) > 1:
                raise ConfigError(f"{name} is swept twice; give its values in one --over")

    @property
    def base(self) -> Setting:
        """Base condition, from which one axis at a time departs."""
        options = self.drives.options
        return Setting(
            weather=options.weathers[0],
            traffic=options.traffic[0],
            lidar_weather=options.lidar_weather,
            faults=options.faults,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """A place on an axis, with one drive and seed."""

    values: tuple[tuple[str, float], ...]
    """Values of the quantities that were set."""
    setting: Setting
    """The condition."""
    drive: Path
    """The drive."""
    number: int
    """Number of the seed, from 0."""

    @property
    def traffic_seed(self) -> int:
        """Number of the seed of the traffic; 0: as recorded."""
        moves = self.setting.factor > 0 and any(name == TRAFFIC for name, _ in self.values)
        return self.number if moves else 0


def points_of(config: SweepConfig) -> list[Point]:
    """All points, axis by axis."""
    axes = [[(axis.name, value) for value in axis.values] for axis in config.axes]
    places = list(product(*axes)) if config.is_product else [(place,) for axis in axes for place in axis]
    points = []
    for place in places:
        setting = config.base
        for name, value in place:
            setting = setting.changed(name, value)
        points += [
            Point(values=place, setting=setting, drive=drive, number=number)
            for drive in config.drives.episodes
            for number in range(config.seeds)
        ]
    return points


@dataclass(slots=True)
class _Group:
    """Settings of one drive and seed, which share a description."""

    episode: Path
    out: Path
    seed: int
    setting: Setting
    settings: dict[Setting, None] = field(default_factory=dict)


def sequences_of_points(
    config: SweepConfig, points: Sequence[Point], report: Callable[[str], None]
) -> list[BenchmarkSequence]:
    """The sequence of each point; points of the same drive, seed and condition share one.

    Args:
        config: The sweep.
        points: Its points.
        report: Called with a line about every drive that is simulated among other traffic.

    Raises:
        CarlaLocError: a drive cannot be read, or an option does not fit it.
    """
    first = {drive: config.drives.options.first_seed(drive) for drive in config.drives.episodes}
    for setting in {point.setting: None for point in points}:
        setting.faults.check(_rig(config, setting).sensors)
    groups: dict[Path, _Group] = {}
    keys = []
    for point in points:
        episode = _episode(config, point, first[point.drive] + point.traffic_seed, report)
        setting = point.setting
        if setting.factor > 1.0:
            setting = replace(setting, traffic="dynamic")
        numbers = (f"{name}={value:.6g}" for name, value in setting.rig)
        words = ("weather" * setting.lidar_weather, setting.faults.calibration.slug, *numbers)
        seed = first[point.drive] + point.number
        out = config.out / DRIVES / episode.stem / "_".join(filter(None, (f"seed{seed}", *words)))
        group = groups.setdefault(out, _Group(episode, out, seed, setting))
        group.settings[setting] = None
        keys.append((out, setting))
    described = {out: _described(config, group) for out, group in groups.items()}
    return [described[out][setting] for out, setting in keys]


def _episode(config: SweepConfig, point: Point, seed: int, report: Callable[[str], None]) -> Path:
    """The drive of a point: as recorded, or among traffic simulated anew."""
    factor = max(point.setting.factor, 1.0)
    if factor == 1.0 and point.traffic_seed == 0:
        return point.drive
    name = f"{point.drive.stem}_x{factor:g}_seed{seed}_{file_sha256(point.drive)[:8]}"
    path = config.out / EPISODES / f"{name}.mcap"
    if not path.exists():
        report(f"{path.name}: traffic × {factor:g}, seed {seed}")
        path.parent.mkdir(parents=True, exist_ok=True)
        change_traffic(point.drive, path, seed, factor=factor, map=config.drives.map)
    return path


def _rig(config: SweepConfig, setting: Setting) -> SensorRig:
    rig = rig_of(config.drives.options)
    for path, value in setting.rig:
        rig = rig.with_value(path, value)
    return rig


def _described(config: SweepConfig, group: _Group) -> dict[Setting, BenchmarkSequence]:
    drives, settings = config.drives, list(group.settings)
    rig = config.drives.options.rig
    if group.setting.rig:
        group.out.parent.mkdir(parents=True, exist_ok=True)
        file = group.out.with_name(f"{group.out.name}.yaml")
        write_whole(file, _rig(config, group.setting).to_yaml())
        rig = str(file)
    options = replace(
        drives.options, weathers=tuple(dict.fromkeys(setting.weather for setting in settings)),
        traffic=tuple(dict.fromkeys(setting.traffic for setting in settings)),
        lidar_weather=group.setting.lidar_weather, faults=group.setting.faults.calibration, seed=group.seed,
        workers=1, rig=rig,
    )  # fmt: skip
    replayed = options.of_drive(
        episode=group.episode, out=group.out, map=drives.map,
        start_s=drives.start_s, duration_s=drives.duration_s,
    )  # fmt: skip
    conditions = tuple(Condition.of(s.weather, traffic_level(s.traffic), s.faults) for s in settings)
    streams = describe_drive(replayed, conditions)
    sequences = (sequence_of(stream, config.out / DRIVES) for stream in streams)
    return dict(zip(settings, sequences, strict=True))
