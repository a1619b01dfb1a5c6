"""Green waves: lights along a town's route let a car pass that sets out with the drive."""

from dataclasses import replace

import numpy as np
import pytest
from shared_fixtures.worlds.towns import town_network

from carlaloc_env.town.config import SignalTiming, TownConfig
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.town.routing.route import Route, plan_route
from carlaloc_env.town.sources import find_town
from carlaloc_env.traffic.signals import (
    DEPARTURE_S,
    PACES,
    Passings,
    SignalPlan,
    SignalState,
    drive_along,
    stop_lines,
    travel_times_s,
    wave_begins_s,
)

TIMING = SignalTiming(green_s=10.0, main_green_s=20.0, left_green_s=6.0)


@pytest.fixture(scope="module")
def network() -> LaneNetwork:
    """Town05's lanes."""
    return town_network("Town05")


@pytest.fixture(scope="module")
def route(network: LaneNetwork) -> Route:
    """Town05's route, past three junctions with lights, each once."""
    config = TownConfig.from_toml(find_town("Town05").with_name("town.toml"))
    return plan_route(network, config.route.points, length_m=config.route.length_m)


def test_cars_of_all_paces_meet_green(network: LaneNetwork, route: Route) -> None:
    """In dense traffic and on a free street they pass every light without a stop, its queue gone before."""
    lines = stop_lines(network, route)
    plan = SignalPlan.from_network(network, TIMING, route)
    assert len(lines.s_m) == 3
    for travel_s, heads in zip(travel_times_s(route, lines.s_m).tolist(), lines.heads, strict=True):
        for pace in PACES:
            arrives_s = DEPARTURE_S + travel_s / pace
            for at_s in (arrives_s, arrives_s - 5.0):
                assert plan.at(round(at_s * 1e9)).state[heads[0]] == SignalState.GREEN


def test_one_light_is_passed_in_the_middle_of_its_green() -> None:
    """Closed form: the car of middle pace arrives half a green after its beginning."""
    passings = Passings(np.array([30.0]), np.array([0]), np.array([12.0]), np.array([26.0]), np.array([60.0]))
    begin_s = wave_begins_s(passings, np.zeros(1))[0]
    arrives_s = DEPARTURE_S + 30.0 / np.array(PACES)
    into_s = np.mod(np.median(arrives_s) - begin_s - 12.0, 60.0)
    assert into_s == pytest.approx(13.0, abs=0.5)
    assert (drive_along(passings, np.array([[begin_s]]))[0] == 0.0).all()


def test_no_other_beginnings_cost_less_waiting() -> None:
    """Two junctions, one passed twice in phases that exclude each other: as good as every pair tried out."""
    passings = Passings(
        np.array([20.0, 45.0, 70.0]),
        np.array([0, 1, 0]),
        np.array([0.0, 5.0, 31.0]),
        np.array([26.0, 20.0, 20.0]),
        np.array([60.0, 50.0, 60.0]),
    )
    best = min(
        drive_along(passings, np.array([[a], [b]]))[0].sum() for a in np.arange(60.0) for b in np.arange(50.0)
    )
    found = drive_along(passings, wave_begins_s(passings, np.zeros(2))[:, None])[0].sum()
    assert best > 0.0
    assert found <= 1.1 * best + 1.0


def test_without_the_wave_or_a_route_cycles_begin_as_ever(network: LaneNetwork, route: Route) -> None:
    equal = replace(TIMING, main_green_s=None)
    plain = SignalPlan.from_network(network, equal)
    without = SignalPlan.from_network(network, replace(equal, green_wave=False), route)
    for second in range(0, 100, 7):
        now = second * 1_000_000_000
        assert (plain.at(now).state == without.at(now).state).all()


def test_main_streets_have_the_longer_green(network: LaneNetwork, route: Route) -> None:
    """Of a junction on the route its own phases have 20 s; junctions elsewhere none."""
    plan = SignalPlan.from_network(network, TIMING, route)
    step_s = 0.25
    states = np.array([plan.at(round(k * step_s * 1e9)).state for k in range(1200)])
    longest = []
    for head in range(len(network.signals)):
        edges = np.flatnonzero(np.diff((states[:, head] == SignalState.GREEN).astype(int)))
        longest.append(step_s * float(np.diff(edges)[::1].min()) if len(edges) > 2 else 0.0)
    passed = {head for heads in stop_lines(network, route).heads for head in heads}
    own = {network.signals[head].junction_id for head in passed}
    for index, head in enumerate(network.signals):
        green_s = min(longest[index], 20.0)
        if index in passed:
            assert green_s == pytest.approx(20.0, abs=step_s)
        elif head.junction_id not in own:
            assert green_s <= 10.0 + step_s


def test_travel_on_a_straight_road_is_distance_over_the_limit(network: LaneNetwork) -> None:
    """Far from the start, each metre of a straight street takes 1 / limit."""
    straight = plan_route(network, [(250.0, 67.75), (100.0, 67.75)])
    times = travel_times_s(straight, np.array([60.0, 110.0]))
    limit = float(straight.speed_limit_mps[-1])
    assert times[1] - times[0] == pytest.approx(50.0 / limit, rel=0.1)
    assert travel_times_s(straight, np.zeros(1))[0] == 0.0
