"""All faults of a rig: which sensor has which, read from words and files, applied to samples."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from hashlib import sha256
from typing import Any

from carlaloc_env.core.clock import TICK_NS, Schedule
from carlaloc_env.core.errors import ConfigError, is_name, unknown_name
from carlaloc_env.core.files.config_files import from_mapping
from carlaloc_env.faults.cameras import CameraFaults
from carlaloc_env.faults.fields import active, quantities
from carlaloc_env.faults.lidars import LidarFaults
from carlaloc_env.faults.navigation import GnssFaults, ImuFaults, WheelFaults
from carlaloc_env.faults.timing import (
    PREFIX,
    Draws,
    MountedFaults,
    TimingFaults,
)
from carlaloc_env.samples import Events, Sample
from carlaloc_env.sensors.base import SensorConfig

KINDS: dict[str, type[TimingFaults]] = {
    "lidar": LidarFaults,
    "camera": CameraFaults,
    "imu": ImuFaults,
    "gnss": GnssFaults,
    "wheels": WheelFaults,
    "radar": MountedFaults,
}
"""Faults by kind of sensor."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Faults:
    """Faults of sensors; equal to no faults where all values are neutral."""

    sensors: tuple[tuple[str, TimingFaults], ...] = ()
    """Faults by ``KIND`` or ``KIND.NAME``, sorted; the latter takes the place of the former."""

    def __post_init__(self) -> None:
        acting = tuple(sorted((target, faults) for target, faults in self.sensors if active(faults)))
        object.__setattr__(self, "sensors", acting)

    def __bool__(self) -> bool:
        return bool(self.sensors)

    @classmethod
    def from_mapping(cls, document: Any, where: str = "faults") -> Faults:
        """Faults of a YAML section such as ``{lidar: {time_offset_ms: 30}}``.

        Raises:
            ConfigError: a sensor or key is unknown, or a value out of range.
        """
        if not isinstance(document, Mapping):
            raise ConfigError(f"{where}: expected sensors, such as {{lidar: {{time_offset_ms: 30}}}}")
        sensors = []
        for target, values in document.items():
            kind, _, name = str(target).partition(".")
            if kind not in KINDS or (name and not is_name(name)):
                raise ConfigError(f"{where}: {unknown_name('sensor with faults', str(target), KINDS)}")
            sensors.append((str(target), from_mapping(KINDS[kind], values, f"{where}: {target}")))
        return cls(sensors=tuple(sensors))

    @classmethod
    def parse(cls, words: Iterable[str]) -> Faults:
        """Faults of words such as ``lidar.time_offset_ms=30`` or ``camera.left.dirt_share=0.2``.

        Raises:
            ConfigError: a sensor or name is unknown, or a value no number in its range.
        """
        document: dict[str, dict[str, float]] = {}
        for word in words:
            path, given, value = word.partition("=")
            target, _, name = path.rpartition(".")
            try:
                number = float(value)
            except ValueError:
                number = float("nan")
            if not given or number != number:
                raise ConfigError(f"fault '{word}'; give SENSOR.NAME=NUMBER, e.g. lidar.time_offset_ms=30")
            fault_quantity(path)
            document.setdefault(target, {})[name] = number
        return cls.from_mapping(document, "fault")

    def to_mapping(self) -> dict[str, dict[str, float]]:
        """Values that are not neutral or default, by sensor."""
        return {
            target: {name: value for name, quantity in quantities(type(faults)).items()
                     if (value := getattr(faults, name)) != quantity.neutral}
            for target, faults in self.sensors
        }  # fmt: skip

    @property
    def label(self) -> str:
        """All values in words, as `parse` reads them; empty: none."""
        pairs = [(f"{t}.{n}", v) for t, values in self.to_mapping().items() for n, v in values.items()]
        return " ".join(f"{path}={value:g}" for path, value in pairs)

    @property
    def slug(self) -> str:
        """A short name for folders; empty: no faults."""
        text = self.label.replace("=", "-").replace(" ", "_").replace("+", "")
        return (
            text if len(text) <= 40 else "faults-" + sha256(repr(self.to_mapping()).encode()).hexdigest()[:8]
        )

    def over(self, other: Faults) -> Faults:
        """These faults, and of another set those of sensors that have none here."""
        return Faults(sensors=tuple({**dict(other.sensors), **dict(self.sensors)}.items()))

    def of(self, config: SensorConfig) -> tuple[str, TimingFaults] | None:
        """Name for which a sensor's faults were given, and the faults; None: it has none."""
        faults = dict(self.sensors)
        for target in (f"{config.kind}.{config.name}", config.kind):
            if target in faults:
                return target, faults[target]
        return None

    def only(self, configs: Iterable[SensorConfig]) -> Faults:
        """The faults of some sensors alone."""
        there = _targets(configs)
        return replace(self, sensors=tuple(pair for pair in self.sensors if pair[0] in there))

    def check(self, configs: Iterable[SensorConfig]) -> None:
        """Refuse faults of sensors that a rig does not have.

        Raises:
            ConfigError: the rig lacks one of them.
        """
        there = _targets(configs)
        for target, _ in self.sensors:
            if target not in there:
                raise ConfigError(unknown_name("sensor with faults in this rig", target, there))

    @property
    def calibration(self) -> Faults:
        """The faults of calibration alone."""
        some = {target: {name: value for name, value in values.items() if name.startswith(PREFIX)}
                for target, values in self.to_mapping().items()}  # fmt: skip
        return Faults.from_mapping({target: values for target, values in some.items() if values})

    def believed(self, config: SensorConfig) -> SensorConfig:
        """The configuration that calibration shows of a sensor."""
        match = self.calibration.of(config)
        return match[1].believed(config) if match else config

    def apply(self, sample: Sample, config: SensorConfig, seed: int) -> Sample | None:
        """A sample of a sensor as its faults leave it: itself where they change nothing; None: lost.

        Args:
            sample: What a sound sensor measured.
            config: The sensor.
            seed: Seed of the noise.
        """
        match = self.of(config)
        if match is None or isinstance(sample, Events) or not match[1].acts_at(sample.stamp_ns):
            return sample
        faults, draws = match[1], _draws(match[0], config, seed)
        stamp_ns = faults.faulty_stamp_ns(sample.stamp_ns, draws)
        if stamp_ns is None:
            return None
        if any(not name.startswith((PREFIX, "time_", "drop_share", "burst_")) for name in active(faults)):
            sample = faults.apply(sample, draws)
        return sample if stamp_ns == sample.stamp_ns else replace(sample, stamp_ns=stamp_ns)

    def stamps_ns(self, stamps_ns: Iterable[int], config: SensorConfig, seed: int) -> list[int | None]:
        """Stamps that the samples of a sensor get [ns]; None: the sample is lost."""
        match = self.of(config)
        if match is None:
            return list(stamps_ns)
        draws = _draws(match[0], config, seed)
        faults = match[1]
        return [faults.faulty_stamp_ns(at, draws) if faults.acts_at(at) else at for at in stamps_ns]


def _targets(configs: Iterable[SensorConfig]) -> set[str]:
    """Names by which faults may be given for some sensors."""
    return {target for config in configs for target in (config.kind, f"{config.kind}.{config.name}")}


def _draws(target: str, config: SensorConfig, seed: int) -> Draws:
    period_ns = Schedule.from_hz(config.rate_hz).period_ticks * TICK_NS
    return Draws(seed=seed, target=target, period_ns=period_ns)


def fault_quantity(path: str) -> Any:
    """The `Quantity` of a fault such as ``lidar.time_offset_ms``.

    Raises:
        ConfigError: the sensor or the name is unknown.
    """
    target, _, name = path.rpartition(".")
    kind = target.partition(".")[0]
    if kind not in KINDS:
        raise ConfigError(unknown_name("sensor with faults", target or path, KINDS))
    quantity_of = quantities(KINDS[kind])
    if name not in quantity_of:
        raise ConfigError(unknown_name(f"fault of {kind}", name, quantity_of))
    return quantity_of[name]
