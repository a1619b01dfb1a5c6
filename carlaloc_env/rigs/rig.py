"""A sensor rig: configurations in a YAML file, and the built sensors that measure a Timeline."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from carlaloc_env.core.errors import ConfigError, check_name, unknown_name
from carlaloc_env.core.files.config_files import from_mapping, to_mapping
from carlaloc_env.core.files.text_files import read_text
from carlaloc_env.faults.faults import Faults
from carlaloc_env.samples import Sample
from carlaloc_env.sensors.base import Sensor, SensorConfig, World
from carlaloc_env.sensors.limits import SENSORS_MAX
from carlaloc_env.sensors.registry import SENSOR_KINDS, config_class, kind_word
from carlaloc_env.timeline.timeline import Timeline

_KEYS = ("name", "extends", "sensors", "faults")
"""Keys of a rig's file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorRig:
    """Sensors that a car carries; plain data, equal when all values are equal."""

    name: str = "rig"
    """Name of the rig."""
    sensors: tuple[SensorConfig, ...] = ()
    """Configurations in the order in which samples of the same stamp are given."""
    faults: Faults = field(default_factory=Faults)
    """Faults of the sensors in replays and benchmarks; an environment refuses them."""

    def __post_init__(self) -> None:
        check_name("name of a rig:", self.name)
        if len(self.sensors) > SENSORS_MAX:
            count = len(self.sensors)
            raise ConfigError(f"rig '{self.name}' has {count} sensors; give at most {SENSORS_MAX}")
        names = [(sensor.kind, sensor.name) for sensor in self.sensors]
        for kind, name in names:
            if names.count((kind, name)) > 1:
                raise ConfigError(f"rig '{self.name}' has two {kind} sensors named '{name}'; rename one")
        self.faults.check(self.sensors)

    def of_kind(self, kind: str) -> tuple[SensorConfig, ...]:
        """Configurations of one kind, e.g. ``"camera"``."""
        return tuple(sensor for sensor in self.sensors if sensor.kind == kind)

    @property
    def frames(self) -> dict[str, NDArray[np.float64]]:
        """Maps each sensor frame's coordinates to `base_link`: (4, 4) by frame_id."""
        return {sensor.frame_id: sensor.mount.T_base_sensor for sensor in self.sensors}

    def believed(self, faults: Faults) -> SensorRig:
        """The rig as its calibration shows it: this one, unless the calibration has faults."""
        return replace(self, sensors=tuple(faults.believed(sensor) for sensor in self.sensors))

    def build(self, world: World) -> Rig:
        """The sensors in a world.

        Raises:
            ConfigError: two sensors give streams of the same name.
        """
        return Rig(self, world)

    def to_mapping(self) -> dict[str, Any]:
        """The rig in plain data."""
        entries = [{"kind": kind_word(sensor), **to_mapping(sensor)} for sensor in self.sensors]
        faults = {"faults": self.faults.to_mapping()} if self.faults else {}
        return {"name": self.name, "sensors": entries, **faults}

    def to_yaml(self) -> str:
        """The rig as a YAML document."""
        text: str = yaml.safe_dump(
            self.to_mapping(), sort_keys=False, default_flow_style=None, width=110, allow_unicode=True
        )
        return text

    def with_value(self, path: str, value: float) -> SensorRig:
        """The rig with another number in a field of a sensor, or of all sensors of a kind.

        Args:
            path: Kind, name, or both, then keys as in the rig's file; in a list they count from 0:
                ``lidar.rate_hz``, ``camera.shutter.readout_ms``, ``camera.right.mount.position_m.1``.
            value: The number; a whole one also fits fields of integers.

        Raises:
            ConfigError: there is no such sensor or field, or it cannot have this value.
        """
        chosen: dict[str, list[SensorConfig]] = {}
        for sensor in self.sensors:
            for word in {sensor.name, sensor.kind, f"{sensor.kind}.{sensor.name}"}:
                chosen.setdefault(word, []).append(sensor)
        word = max((word for word in chosen if path.startswith(f"{word}.")), key=len, default="")
        if not word:
            raise ConfigError(f"rig.{path}: {unknown_name('sensor', path.partition('.')[0], chosen)}")
        number = int(value) if float(value).is_integer() else value
        entries = []
        for sensor in chosen[word]:
            entry = {"kind": kind_word(sensor), **to_mapping(sensor)}
            _put(entry, path.removeprefix(f"{word}."), number, f"rig.{path}")
            entries.append(entry)
        document = {"name": self.name, "extends": self.name, "sensors": entries}
        return SensorRig.from_mapping(document, f"rig.{path}", {self.name: lambda: self})

    @classmethod
    def from_yaml(cls, text: str, where: str = "rig", bases: Bases | None = None) -> SensorRig:
        """Rig of a YAML document.

        Args:
            text: The document.
            where: File name for messages.
            bases: Rigs that the document may extend.

        Raises:
            ConfigError: the document is not YAML, or a key, kind or value is not valid.
        """
        try:
            document = yaml.safe_load(text)
        except yaml.YAMLError as error:
            raise ConfigError(f"{where}: not valid YAML: {' '.join(str(error).split())}") from error
        return cls.from_mapping(document, where, bases)

    @classmethod
    def from_mapping(cls, document: object, where: str = "rig", bases: Bases | None = None) -> SensorRig:
        """Rig of plain data, as `to_mapping` gives it.

        With the key ``extends`` the data have the sensors of another rig, too. An entry whose kind and name
        are those of such a sensor changes the values that it names; any other entry adds a sensor.

        Args:
            document: The data.
            where: File name for messages.
            bases: Rigs that the data may extend, e.g. `presets.RIGS`.

        Raises:
            ConfigError: a key, kind or value is not valid.
        """
        if not isinstance(document, Mapping):
            raise ConfigError(f"{where}: expected the keys 'name' and 'sensors'")
        for key in document:
            if key not in _KEYS:
                raise ConfigError(f"{where}: {unknown_name('key', str(key), _KEYS)}")
        entries = document.get("sensors") or []
        if not isinstance(entries, list):
            raise ConfigError(f"{where}: 'sensors' must be a list")
        base = _base(document.get("extends"), where, bases)
        sensors = list(base.sensors)
        left = list(base.sensors)
        for i, entry in enumerate(entries):
            here = f"{where}: sensors[{i}]"
            changed = _changed(entry, left, here)
            if changed is None:
                sensors.append(_sensor(entry, here))
            else:
                left.remove(changed)
                sensors[sensors.index(changed)] = _sensor(entry, here, to_mapping(changed))
        faults = base.faults
        if document.get("faults"):
            faults = Faults.from_mapping(document["faults"], f"{where}: faults")
        return cls(name=str(document.get("name", "rig")), sensors=tuple(sensors), faults=faults)

    @classmethod
    def load(cls, path: str | Path, bases: Bases | None = None) -> SensorRig:
        """Rig of a YAML file, see `from_mapping`.

        Raises:
            ConfigError: the file cannot be read or is not a valid rig.
        """
        return cls.from_yaml(read_text(path, "rig"), Path(path).name, bases)


Bases = Mapping[str, Callable[[], SensorRig]]
"""Makers of rigs by name."""


class Rig:
    """Built sensors. `measure` has no memory: any span may be asked for, in any order."""

    def __init__(self, config: SensorRig, world: World) -> None:
        if config.faults:
            what = f"rig '{config.name}' has faults, which act in replays and benchmarks alone"
            raise ConfigError(f"{what}; remove the key 'faults'")
        self.config = config
        self.sensors: tuple[Sensor, ...] = tuple(sensor.build(world) for sensor in config.sensors)
        # Spaces of pictures are as large as pictures: they are not kept.
        self.streams = tuple(stream for sensor in self.sensors for stream in sensor.streams())
        """Names of all streams, in the order of the sensors."""
        for stream, times in Counter(self.streams).items():
            if times > 1:
                raise ConfigError(f"rig '{config.name}' has two streams named '{stream}'; rename one sensor")

    def measure(self, timeline: Timeline, first_ns: int, end_ns: int) -> list[Sample]:
        """All samples that become complete after `first_ns` and not later than `end_ns`.

        A sample is complete at its stamp plus its sensor's latency, so spans that follow each other
        give every sample once. A drive from its very beginning is ``measure(timeline, -1, end)``.

        Args:
            timeline: Where everything was; must reach `end_ns`.
            first_ns: End of the span before [ns].
            end_ns: End of this span [ns].

        Returns:
            Samples by stamp, those of one stamp in the order of the rig.
        """
        samples: list[tuple[int, int, Sample]] = []
        for place, sensor in enumerate(self.sensors):
            stamps = self.stamps_ns(sensor, first_ns, end_ns)
            samples += [(sample.stamp_ns, place, sample) for sample in sensor.measure(timeline, stamps)]
        return [sample for _, _, sample in sorted(samples, key=lambda item: item[:2])]

    @staticmethod
    def stamps_ns(sensor: Sensor, first_ns: int, end_ns: int) -> list[int]:
        """Stamps [ns] of a sensor's samples that become complete in (first_ns, end_ns]."""
        begin = max(first_ns - sensor.latency_ns + 1, 0)
        return sensor.schedule.stamps_ns_in(begin, end_ns - sensor.latency_ns + 1)


def _put(entry: dict[str, Any], path: str, number: float, where: str) -> None:
    """Put a number into nested plain data."""
    node: Any = entry
    *above, last = path.split(".")
    try:
        for key in above:
            if not isinstance(node, list) and node.get(key) is None:
                node[key] = {}  # a part that is off, such as a shutter
            node = node[int(key)] if isinstance(node, list) else node[key]
        node[int(last) if isinstance(node, list) else last] = number
    except (TypeError, ValueError, IndexError, AttributeError):
        raise ConfigError(f"{where}: no such field; carlaloc list rigs prints a rig's fields") from None


def _base(name: Any, where: str, bases: Bases | None) -> SensorRig:
    """The rig that a document extends; an empty one where it extends none."""
    if name is None:
        return SensorRig()
    if bases is None:
        raise ConfigError(f"{where}: 'extends' needs the named rigs; read the file with rig_by_name")
    if str(name) not in bases:
        raise ConfigError(f"{where}: extends: {unknown_name('rig', str(name), bases)}")
    return bases[str(name)]()


def _changed(entry: Any, sensors: list[SensorConfig], where: str) -> SensorConfig | None:
    """The sensor of the extended rig that an entry changes; None: the entry is a new sensor."""
    if not isinstance(entry, Mapping):
        return None
    alike = [sensor for sensor in sensors if entry.get("kind") in (sensor.kind, kind_word(sensor))]
    if "name" in entry:
        return next((sensor for sensor in alike if sensor.name == entry["name"]), None)
    if len(alike) > 1:
        names = ", ".join(sensor.name for sensor in alike)
        raise ConfigError(f"{where}: give the 'name' of the {alike[0].kind} to change: {names}")
    return alike[0] if alike else None


def _sensor(entry: Any, where: str, base: Mapping[str, Any] | None = None) -> SensorConfig:
    if not isinstance(entry, Mapping) or "kind" not in entry:
        raise ConfigError(f"{where}: the key 'kind' is missing; use one of {', '.join(SENSOR_KINDS)}")
    kind = str(entry["kind"])
    try:
        config = config_class(kind)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from error
    values = {key: value for key, value in entry.items() if key not in ("kind", "preset")}
    where = f"{where} ({kind})"
    try:
        preset = config.preset_values(str(entry["preset"])) if "preset" in entry else {}
        plain = {key: to_mapping(part) if is_dataclass(part) else part for key, part in preset.items()}
        # Of the sensor that changes, a preset leaves what no preset of its kind has, such as its mount.
        drop = config.preset_keys()
        base = {k: v for k, v in (base or {}).items() if "preset" not in entry or k not in drop}
        values = config.file_values(values, {**base, **plain})
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from error
    return from_mapping(config, values, where)
