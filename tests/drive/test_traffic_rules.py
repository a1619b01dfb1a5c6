"""Which violations are seen, when they begin, and how often they count."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain

import numpy as np
import pytest

from carlaloc_env.driving.driver_view import DriverView
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.town.town import Town
from carlaloc_env.traffic.signals import SignalState
from carlaloc_env.traffic.traffic_config import traffic_of_town
from recorder.drive.rule_monitor import RuleMonitor


def look(watch: RuleMonitor, base: DriverView, **values: object) -> list[str]:
    return watch.update(replace(base, **values))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def seen(town03: Town) -> Iterator[DriverView]:
    world = DrivingWorld(town03, traffic_of_town(town03, "static", 0))
    world.reset(0)
    yield world.driver_view()
    world.close()


def test_red_light_is_counted_once_and_only_when_crossed(town03: Town, seen: DriverView) -> None:
    watch = RuleMonitor(town03.network)
    red = int(SignalState.RED)
    begun = []
    for distance in (1.2, 0.7, 0.2, -0.3, -0.8, -1.3):
        begun += look(watch, seen, stop_line_distance_m=distance, signal_state=red, speed_mps=10.0)
    assert begun.count("red_light") == 1
    for state, speed in ((int(SignalState.GREEN), 10.0), (red, 0.0)):
        watch = RuleMonitor(town03.network)
        begun = []
        for distance in (0.5, 0.2, -0.2, -0.5):
            begun += look(watch, seen, stop_line_distance_m=distance, signal_state=state, speed_mps=speed)
        assert "red_light" not in begun


def test_rules_of_the_road(town03: Town, seen: DriverView) -> None:
    watch = RuleMonitor(town03.network)
    assert not any(look(watch, seen) for _ in range(60))
    fast = [look(watch, seen, speed_mps=seen.speed_limit_mps + 4.0) for _ in range(60)]
    assert list(chain(*fast)) == ["speeding"]
    assert fast.index(["speeding"]) == 39
    normal = np.array([-np.sin(seen.heading_rad), np.cos(seen.heading_rad), 0.0])
    beyond = [
        look(watch, seen, position_m=seen.position_m - 12.0 * normal, offset_m=-12.0) for _ in range(20)
    ]
    assert {"off_road", "off_route"} <= set(chain(*beyond))
    watch = RuleMonitor(town03.network)
    turned = [look(watch, seen, heading_rad=seen.heading_rad + np.pi, speed_mps=5.0) for _ in range(40)]
    assert list(chain(*turned)) == ["wrong_way"]
