"""Each option of the traffic acts as its name says; wrong ones are refused."""

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from shared_fixtures.worlds.towns import town_network

from benchmarks.traffic_audit import NOBODY, TrafficReport, audit_traffic
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.sources import find_town
from carlaloc_env.town.build import load_town
from carlaloc_env.traffic.standing_traffic import TrafficTables
from carlaloc_env.traffic.tables.lane_tables import TAKEN
from carlaloc_env.traffic.traffic_config import TrafficConfig, traffic_of_town
from carlaloc_env.traffic.world import TrafficWorld


@pytest.fixture(scope="module")
def tables() -> TrafficTables:
    """What traffic knows of Town03."""
    return TrafficTables(load_town("Town03").network)


@pytest.fixture(scope="module")
def motorway() -> TrafficTables:
    """What traffic knows of Town04, where lanes are changed for speed."""
    return TrafficTables(town_network("Town04"))


def watch(tables: TrafficTables, seconds: float = 60.0, vehicles: int = 60, **options: Any) -> TrafficReport:
    """A run of Town03 under some options."""
    config = TrafficConfig(vehicles=vehicles, walkers=0, seed=3, warm_up_s=5.0, **options)
    return audit_traffic(tables.network, config, seconds, tables)


def steps(
    tables: TrafficTables, seconds: int, vehicles: int = 60, walkers: int = 0, **options: Any
) -> Iterator[TrafficWorld]:
    """The world of a run under some options, after each step."""
    config = TrafficConfig(vehicles=vehicles, walkers=walkers, seed=3, **{"warm_up_s": 5.0, **options})
    world = TrafficWorld(tables.network, config, tables)
    world.reset()
    for _ in range(seconds * 1_000_000_000 // STEP_NS):
        world.step(NOBODY)
        yield world


@pytest.fixture(scope="module")
def usual(tables: TrafficTables) -> TrafficReport:
    """A run without options."""
    return watch(tables)


def test_speed_difference_slows_everybody(tables: TrafficTables, usual: TrafficReport) -> None:
    assert watch(tables, global_percentage_speed_difference=60.0).speed_fraction < 0.75 * usual.speed_fraction


def test_auto_lane_change_off_leaves_the_necessary_ones(motorway: TrafficTables) -> None:
    without = watch(motorway, auto_lane_change=False)
    assert 0 < without.lane_changes < 0.7 * watch(motorway).lane_changes


@pytest.mark.parametrize("side", ["left", "right"])
def test_random_lane_changes_add_changes(motorway: TrafficTables, side: str) -> None:
    few = watch(motorway, auto_lane_change=False)
    options: dict[str, Any] = {f"random_{side}_lanechange_percentage": 50.0}
    more = watch(motorway, auto_lane_change=False, **options)
    assert more.lane_changes > few.lane_changes


def test_ignored_lights_are_run(tables: TrafficTables, usual: TrafficReport) -> None:
    assert usual.red_runs == 0
    assert watch(tables, ignore_lights_percentage=100.0).red_runs > 3


def test_ignored_vehicles_are_driven_into(tables: TrafficTables, usual: TrafficReport) -> None:
    careless = watch(tables, ignore_vehicles_percentage=60.0)
    assert careless.overlap_fraction > max(0.005, 5.0 * usual.overlap_fraction)


def test_keep_right_rule_fills_the_right_lanes(tables: TrafficTables) -> None:
    """More of those who could be on either of two lanes drive on the right one."""

    def share(percentage: float) -> float:
        right, lane = tables.roads.lane.right, np.zeros(60, np.int64)
        outer = many = 0
        for step, world in enumerate(steps(tables, 60, keep_right_rule_percentage=percentage)):
            if step % 20 == 0:
                lane = world._vehicles.fleet.plan[:-1, 0]
                beside = (right[lane] >= 0) | (tables.roads.lane.left[lane] >= 0)
                outer += int((beside & (right[lane] < 0)).sum())
                many += int(beside.sum())
        return outer / many

    assert share(100.0) > share(0.0)


def test_distance_to_leading_vehicle_is_kept(tables: TrafficTables) -> None:
    """Vehicles that stand behind a standing one keep that gap."""
    gaps = {}
    for distance in (2.0, 6.0):
        usual_s = TrafficConfig().warm_up_s
        *_, world = steps(tables, 60, 200, warm_up_s=usual_s, distance_to_leading_vehicle=distance)
        fleet = world._vehicles.fleet
        behind = np.flatnonzero((fleet.leader[:-1] >= 0) & (fleet.gap_m[:-1] < 12.0))
        standing = behind[(fleet.waited_s[behind] > 2.0) & (fleet.waited_s[fleet.leader[behind]] > 3.0)]
        assert len(standing) > 3
        gaps[distance] = float(np.median(fleet.gap_m[standing]))
    assert gaps[2.0] == pytest.approx(2.0, abs=1.0)
    assert gaps[6.0] == pytest.approx(6.0, abs=1.5)


def driven_through(tables: TrafficTables, percentage: float) -> int:
    """Fronts that came onto a crosswalk in two minutes while a walker was on its way over that lane."""
    config = TrafficConfig(
        vehicles=150, walkers=120, seed=3, warm_up_s=5.0, ignore_walkers_percentage=percentage
    )
    world = TrafficWorld(tables.network, config, tables)
    world.reset()
    fleet, crossing = world._vehicles.fleet, tables.roads.crossing
    length = world._vehicles.drivers.length_m[:-1]
    lane, front, taken, count = np.zeros(0, np.int64), np.zeros(0), world._taken.copy(), 0
    for _ in range(20 * 120):
        world.step(NOBODY)
        now_lane, now_front = fleet.plan[:-1, 0].copy(), fleet.station_m[:-1] + 0.5 * length
        for k in np.flatnonzero((taken == TAKEN) & (world._taken == TAKEN)) if len(lane) else ():
            here = (lane == crossing.lane[k]) & (now_lane == lane)
            enter = crossing.enter_m[k]
            count += int((here & (front < enter) & (now_front >= enter)).sum())
        lane, front, taken = now_lane, now_front, world._taken.copy()
    return count


def test_ignored_walkers_are_not_given_way(tables: TrafficTables) -> None:
    """Drivers who do not mind walkers come onto crosswalks that walkers use; the others hardly ever do."""
    usual = driven_through(tables, 0.0)
    assert driven_through(tables, 100.0) > max(5, 3 * usual)


def stops(tables: TrafficTables, percentage: float) -> int:
    """How many vehicles come to a stand at a stop sign in a minute."""
    stood = 0
    for world in steps(tables, 60, ignore_signs_percentage=percentage):
        fleet = world._vehicles.fleet
        stood += int((fleet.at_stop_sign[:-1] & (fleet.stopped_s[:-1] > 0.9)).sum())
    return stood


def test_ignored_signs_are_not_stopped_at(tables: TrafficTables) -> None:
    assert stops(tables, 100.0) == 0
    assert stops(tables, 0.0) > 0


def test_options_come_with_the_level() -> None:
    """A level in words may carry options; a mapping says the same."""
    config = TownConfig.from_toml(find_town("Town03").with_name("town.toml"))
    town: Any = SimpleNamespace(config=config, network=None)
    text = traffic_of_town(town, "0.5,ignore_lights_percentage=20,auto_lane_change=false", 7)
    same = traffic_of_town(
        town, {"level": 0.5, "ignore_lights_percentage": 20.0, "auto_lane_change": False}, 7
    )
    assert text == same
    assert text.ignore_lights_percentage == 20.0
    assert not text.auto_lane_change
    assert text.seed == 7
    with pytest.raises(ConfigError, match="ignore_lights_percentage"):
        traffic_of_town(town, "dynamic,ignore_light_percentage=20", 7)
    with pytest.raises(ConfigError, match="no number"):
        traffic_of_town(town, "dynamic,ignore_lights_percentage=many", 7)


@pytest.mark.parametrize(
    "options",
    [
        {"ignore_lights_percentage": 101.0},
        {"global_percentage_speed_difference": 100.0},
        {"distance_to_leading_vehicle": 0.0},
    ],
)
def test_wrong_options_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(ConfigError):
        TrafficConfig(**options)
