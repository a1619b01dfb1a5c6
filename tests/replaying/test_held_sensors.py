"""Sensors that a worker keeps for its next unit: no longer than they can be of use, and never two."""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from typing import Any, ClassVar

import pytest

from recorder.episode.traffic_level import TrafficLevel, traffic_level
from recorder.replaying import unit_work


class Sensors:
    """Sensors that know who else is there when they are made."""

    alive: ClassVar[weakref.WeakSet[Sensors]] = weakref.WeakSet()

    def __init__(self, recipe: Any, level: TrafficLevel) -> None:
        assert not self.alive, "others are still held"
        self.recipe, self.level = recipe, level
        self.alive.add(self)

    def close(self) -> None:
        """Nothing to give back."""


@pytest.fixture(autouse=True)
def sensors(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(unit_work, "LevelSensors", Sensors)
    unit_work.release_sensors()
    yield
    unit_work.release_sensors()


def hold(level: str, recipe: Any = "a drive") -> int:
    return id(unit_work._sensors_of(recipe, traffic_level(level)))


def test_the_next_unit_of_a_level_gets_the_same_and_another_level_others() -> None:
    assert hold("dynamic") == hold("dynamic")
    assert len(Sensors.alive) == 1
    hold("static")
    assert [one.level.name for one in Sensors.alive] == ["static"]
    hold("static", "another drive")
    assert [one.recipe for one in Sensors.alive] == ["another drive"]


def test_a_level_that_is_assembled_is_not_held_any_more() -> None:
    """All of its units are whole; another level's sensors wait for their next unit."""
    hold("dynamic")
    unit_work._forget_level(traffic_level("static"))
    assert len(Sensors.alive) == 1
    unit_work._forget_level(traffic_level("dynamic"))
    assert not Sensors.alive
