"""Common parts of the table's rows: their fields, and the town, drive and rivals of all rows."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from naive_pybullet import NaiveWorld
from scenario import RANGE_M, SEED, TOWN, Drive, drive_among
from timing import Timing

from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.base import Sensor
from carlaloc_env.town.build import load_town
from carlaloc_env.town.town import Town
from carlaloc_env.weather.presets import weather_by_name

ACTORS_IN_RANGE = 50


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One line of the table."""

    name: str
    """Short name, for ``--only``."""
    what: str
    """Measured quantity."""
    value: float | None
    """The reported figure; None when it could not be measured."""
    unit: str
    """Its unit."""
    target: float | None = None
    """Target of the figure; None when it is only reported."""
    at_least: bool = True
    """Whether more is better."""
    ours: Timing | None = None
    """Times of this project."""
    naive: Timing | None = None
    """Times of PyBullet used the usual way."""
    note: str = ""
    """Circumstances, or why it could not be measured."""
    detail: dict[str, float] = field(default_factory=dict)
    """Further figures."""

    @property
    def passed(self) -> bool | None:
        """Whether the target is reached; None without a target or a figure."""
        if self.target is None or self.value is None:
            return None
        return self.value >= self.target if self.at_least else self.value <= self.target

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "name": self.name,
            "what": self.what,
            "value": self.value,
            "unit": self.unit,
            "target": self.target,
            "at_least": self.at_least,
            "passed": self.passed,
            "ours": self.ours.to_json() if self.ours else None,
            "naive": self.naive.to_json() if self.naive else None,
            "note": self.note,
            **self.detail,
        }


class Bench:
    """Everything that several rows need, made when first asked for.

    Args:
        repeat: How often each call is timed.
        quick: Whether to take few calls and short drives, to see that everything runs.
    """

    def __init__(self, *, repeat: int, quick: bool) -> None:
        self.repeat = repeat
        self.quick = quick

    @cached_property
    def town(self) -> Town:
        """The town of all rows."""
        return load_town(TOWN)

    @cached_property
    def drive(self) -> Drive:
        """A drive among many actors."""
        return drive_among(
            self.town, ACTORS_IN_RANGE, steps=5 if self.quick else 100, sweeps=1 if self.quick else 4
        )

    @cached_property
    def stage(self) -> SensorStage:
        """The world that sensors of this project measure."""
        return SensorStage(self.town, seed=SEED, weather=weather_by_name("ClearNoon"))

    @cached_property
    def naive(self) -> NaiveWorld:
        """The same town in PyBullet; the ego's surroundings alone for a quick run."""
        if not self.quick:
            return NaiveWorld(self.town.chunks)
        place = self.drive.timeline.ego_motion([self.drive.stamps_ns[0]]).position_m[0]
        near = [c for c in self.town.chunks if np.abs(c.bounds_m.mean(axis=0) - place).max() < RANGE_M]
        return NaiveWorld(near)

    def naive_drive(self) -> NaiveWorld:
        """The same town and the drive's actors in PyBullet."""
        drive = self.drive
        place = drive.timeline.ego_motion([drive.stamps_ns[0]]).position_m[0]
        self.naive.stand(drive.timeline.catalog, place)
        self.naive.move_actors(drive.timeline.actors_at(drive.stamps_ns[0]))
        return self.naive

    def sensor(self, kind: type) -> Sensor:
        """The paper's first sensor of a kind."""
        config = next(config for config in rig_by_name("paper").sensors if isinstance(config, kind))
        return config.build(self.stage)

    def sweep(self, sensor: Sensor) -> Callable[[], object]:
        """A call that measures the drive's stamps in turn."""
        stamps = self._round()
        return lambda: sensor.measure(self.drive.timeline, [next(stamps)])

    def _round(self) -> Iterator[int]:
        while True:
            yield from self.drive.stamps_ns


def compared(name: str, what: str, times: dict[str, Timing], target: float, note: str) -> Row:
    """A row with the speed of ours relative to PyBullet's."""
    ours, naive = times["ours"], times["naive"]
    return Row(
        name=name,
        what=what,
        value=naive.median_s / ours.median_s,
        unit="× faster",
        target=target,
        ours=ours,
        naive=naive,
        note=note,
        detail={"ratio_of_least": naive.least_s / ours.least_s, "ratio_of_cpu": naive.cpu_s / ours.cpu_s},
    )
