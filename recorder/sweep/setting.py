"""A condition as a point of a space of quantities, and axes through it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.faults.faults import Faults, fault_quantity
from carlaloc_env.weather.parameters import changed_weather, weather_quantities, with_quantity
from recorder.episode.summary import LEVELS

TRAFFIC, FAULT = "traffic", "fault."
"""Name of the factor of the traffic, and beginning of the names of faults."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """Weather, traffic and faults in one word each."""

    weather: str = "ClearNoon"
    """A weather with its changes, or a schedule."""
    traffic: str = "dynamic"
    """A traffic level, or a factor of the recorded traffic; above 1 it is simulated anew."""
    lidar_weather: bool = False
    """Whether the weather reaches the LiDARs."""
    faults: Faults = field(default_factory=Faults)
    """Faults of the sensors."""

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
            known = self.faults.to_mapping()
            known[target] = {**known.get(target, {}), key: value}
            return replace(self, faults=Faults.from_mapping(known))
        if name not in weather_quantities():
            names = (TRAFFIC, *weather_quantities(), "fault.lidar.time_offset_ms")
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
    """``traffic``, a quantity of the weather, or ``fault.SENSOR.NAME``."""
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
