"""The conditions of a replay: which weather, how much of the traffic."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.weather.schedule import Weather, weather_of


@dataclass(frozen=True, slots=True, kw_only=True)
class TrafficLevel:
    """How many of the recorded actors a replay shows; the ego's motion never depends on it."""

    name: str
    """``static``, ``dynamic`` or ``trafficNN`` (per cent)."""
    fraction: float
    """Share of the actors that stay, 0–1."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.fraction <= 1.0:
            raise ConfigError(f"traffic fraction {self.fraction:g}; give a number from 0 to 1")

    def select(self, timeline: Timeline) -> Timeline:
        """The same drive with this share of the actors.

        Who stays is decided by a hash of the actor's id, so a larger share contains every smaller one.
        """
        if self.fraction >= 1.0:
            return timeline
        keep = [
            index
            for index, actor in enumerate(timeline.catalog.id)
            if int.from_bytes(hashlib.blake2b(str(int(actor)).encode(), digest_size=4).digest(), "big")
            < self.fraction * 2**32
        ]
        return timeline.select_actors(np.array(keep, dtype=np.intp))


def traffic_level(text: str) -> TrafficLevel:
    """Level of a name or number: ``static``, ``dynamic`` or a fraction such as ``0.5``.

    Raises:
        ConfigError: neither a known name nor a number from 0 to 1.
    """
    named = {"static": 0.0, "dynamic": 1.0}
    if text in named:
        return TrafficLevel(name=text, fraction=named[text])
    try:
        fraction = float(text)
    except ValueError:
        message = unknown_name("traffic level", text, [*named, "a fraction such as 0.5"])
        raise ConfigError(message) from None
    return TrafficLevel(name=f"traffic{round(100 * fraction):02d}", fraction=fraction)


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """One sequence of a dataset: a weather and a traffic level."""

    weather_name: str
    """Name of the weather, part of the folder's name."""
    weather: Weather
    """Parameters of the weather, or a schedule."""
    traffic: TrafficLevel
    """Share of the traffic."""

    @property
    def name(self) -> str:
        """Folder of the sequence, e.g. ``ClearNoon_dynamic``."""
        return f"{self.weather_name}_{self.traffic.name}"


def conditions_of(weathers: Sequence[str], levels: Sequence[str]) -> tuple[Condition, ...]:
    """All combinations, weather by weather within each traffic level.

    Raises:
        ConfigError: an unknown weather or level, or none at all.
    """
    if not weathers or not levels:
        raise ConfigError("a replay needs at least one weather and one traffic level")
    return tuple(
        Condition(weather_name=Path(name).stem, weather=weather_of(name), traffic=level)
        for level in dict.fromkeys(traffic_level(text) for text in levels)
        for name in dict.fromkeys(weathers)
    )
