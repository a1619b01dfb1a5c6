"""Conditions of a replay: weather, traffic and faults."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from carlaloc_env.core.errors import ConfigError, check_name
from carlaloc_env.faults.faults import Faults
from carlaloc_env.weather.presets import weather_word
from carlaloc_env.weather.schedule import Weather, weather_of
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

    @classmethod
    def of(cls, weather: str, traffic: TrafficLevel, faults: Faults) -> Condition:
        """The condition of a weather by its name or schedule."""
        name = weather_word(weather)
        return cls(weather_name=name, weather=weather_of(weather), traffic=traffic, faults=faults)

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
        Condition.of(name, level, faults or Faults())
        for level in dict.fromkeys(traffic_level(text) for text in levels)
        for name in dict.fromkeys(weathers)
    )
