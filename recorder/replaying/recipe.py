"""Input of workers: the recipe of a drive's sequences, and units, the stretches that they make.

A unit needs only the episode. No byte of a dataset depends on the length of units.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.rigs.rig import SensorRig
from recorder.episode.traffic_level import TrafficLevel
from recorder.replaying.conditions import Condition
from recorder.replaying.roadside import RoadsideUnit


@dataclass(frozen=True, slots=True, kw_only=True)
class Recipe:
    """All sequences to make of a drive."""

    episode: Path
    """The drive, absolute path."""
    car: int = 1
    """Car that carries the rig, from 1."""
    roadside: RoadsideUnit | None = None
    """Fixed unit that carries it in place of a car."""
    agent: int = 1
    """Number of that car as an actor of others; negative for a unit."""
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
    truth_tf: bool
    """Whether bags have the car's true pose as a transform."""
    clock: bool
    """Whether bags have `/clock`."""
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
