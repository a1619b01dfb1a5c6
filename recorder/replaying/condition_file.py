"""A condition as a file: weather, traffic, faults, stretch and seed, as commands read it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.core.files.config_files import from_mapping
from carlaloc_env.core.files.text_files import read_text
from carlaloc_env.faults.faults import Faults
from carlaloc_env.weather.schedule import weather_of
from recorder.episode.traffic_level import traffic_level


@dataclass(frozen=True, slots=True, kw_only=True)
class ConditionFile:
    """Values of a condition file; the command gives those that it leaves out."""

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
        condition = from_mapping(cls, document, path.name)
        weather_of(condition.weather)
        traffic_level(condition.traffic)
        Faults.from_mapping(condition.faults, f"{path.name}: faults")
        return condition

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
