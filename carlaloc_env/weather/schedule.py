"""Weather that changes during a drive: a list of times and weathers, and the weathers between them.

A schedule stands wherever a weather may stand.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.core.files.text_files import read_text
from carlaloc_env.weather.parameters import RANGES, WeatherParameters
from carlaloc_env.weather.presets import changed_weather, weather_by_name

STEP_NS = 1_000_000_000
"""The weather changes once a second: each new one costs a sky and a shadow map."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WeatherSchedule:
    """Weathers at times since the drive began; every field changes evenly from one to the next.

    Before the first time, the first weather holds; after the last time, the last weather. In YAML it is
    a list::

        - at_s: 0
          weather: ClearNoon
        - at_s: 120
          weather: {cloudiness: 90, precipitation: 40, precipitation_deposits: 30}
    """

    at_s: tuple[float, ...]
    """Times since the drive began [s], rising."""
    weathers: tuple[WeatherParameters, ...]
    """Weather at each of them."""

    def __post_init__(self) -> None:
        if not self.at_s or len(self.at_s) != len(self.weathers):
            raise ConfigError("weather schedule: give as many times as weathers, and at least one")
        if not all(math.isfinite(t) for t in self.at_s) or any(
            b <= a for a, b in zip(self.at_s, self.at_s[1:], strict=False)
        ):
            raise ConfigError(f"weather schedule: the times {list(self.at_s)} do not rise; sort them")
        for before, after in zip(self.weathers, self.weathers[1:], strict=False):
            if max(before.precipitation, after.precipitation) * max(before.snowfall, after.snowfall) > 0.0:
                raise ConfigError("weather schedule: rain turns into snow; put a time without either between")

    def at(self, stamp_ns: int) -> WeatherParameters:
        """Weather of a time since the drive began [ns]; it changes in steps of `STEP_NS`."""
        now_s = stamp_ns // STEP_NS * (STEP_NS * 1e-9)
        after = bisect_right(self.at_s, now_s)
        if after == 0:
            return self.weathers[0]
        if after == len(self.at_s):
            return self.weathers[-1]
        begin, end = self.weathers[after - 1], self.weathers[after]
        share = (now_s - self.at_s[after - 1]) / (self.at_s[after] - self.at_s[after - 1])
        values = ((name, getattr(begin, name), getattr(end, name)) for name in RANGES)
        return WeatherParameters(**{name: first + share * (last - first) for name, first, last in values})

    def to_mapping(self) -> dict[str, Any]:
        """Plain data, for YAML files."""
        return {
            "schedule": [
                {"at_s": at_s, "weather": weather.to_mapping()}
                for at_s, weather in zip(self.at_s, self.weathers, strict=True)
            ]
        }

    @classmethod
    def from_yaml(cls, text: str, where: str = "weather schedule") -> WeatherSchedule:
        """Schedule of a YAML text.

        Args:
            text: A list of ``at_s`` and ``weather``: a preset's name, or fields of `WeatherParameters`.
            where: Name of the file, for messages.

        Raises:
            ConfigError: not YAML, an unknown key, weather or field, or times that do not rise.
        """
        try:
            rows = yaml.safe_load(text)
        except yaml.YAMLError as error:
            raise ConfigError(f"{where}: not YAML ({' '.join(str(error).split())})") from error
        return cls.from_rows(rows, where)

    @classmethod
    def from_rows(cls, rows: object, where: str = "weather schedule") -> WeatherSchedule:
        """Schedule of a list of ``at_s`` and ``weather``.

        Raises:
            ConfigError: an unknown key, weather or field, or times that do not rise.
        """
        if not isinstance(rows, list) or not all(
            isinstance(row, dict) and set(row) == {"at_s", "weather"} for row in rows
        ):
            raise ConfigError(f"{where}: expected a list of rows such as '- {{at_s: 0, weather: ClearNoon}}'")
        try:
            return cls(
                at_s=tuple(float(row["at_s"]) for row in rows),
                weathers=tuple(_weather(row["weather"]) for row in rows),
            )
        except (ConfigError, TypeError, ValueError) as error:
            raise ConfigError(f"{where}: {error}") from error


Weather = WeatherParameters | WeatherSchedule
"""Either kind; both have ``at(stamp_ns)`` and ``to_mapping()``."""


def weather_of(what: str | Path | Weather | Mapping[str, Any]) -> Weather:
    """Weather by a preset's name with changes, the path of a schedule (``.yaml``), or a mapping of fields.

    Raises:
        ConfigError: there is no such preset or field, or the file is missing or wrong.
    """
    if isinstance(what, (WeatherParameters, WeatherSchedule)):
        return what
    if isinstance(what, Mapping):
        if "schedule" in what:
            return WeatherSchedule.from_rows(what["schedule"])
        return WeatherParameters.from_mapping(what)
    path = Path(what)
    if path.suffix.lower() not in (".yaml", ".yml"):
        return changed_weather(str(what))
    return WeatherSchedule.from_yaml(read_text(path, "weather schedule"), where=path.name)


def _weather(what: Any) -> WeatherParameters:
    if isinstance(what, str):
        return weather_by_name(what)
    if isinstance(what, dict):
        return WeatherParameters.from_mapping(what)
    raise ConfigError(f"weather {what!r}: give a preset's name or fields such as 'fog_density: 80'")
