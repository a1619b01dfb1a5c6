"""Coordinated lights: platoons along a town's main streets, and a green wave for the ego."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures.worlds.towns import town_network

from carlaloc_env.map.config import SignalTiming, TownConfig
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.routing.plan_route import plan_route
from carlaloc_env.map.routing.route import Route
from carlaloc_env.map.sources import find_town
from carlaloc_env.town.build import load_town
from carlaloc_env.traffic.signals import PACE, SignalPlan, SignalState
from carlaloc_env.traffic.standing_traffic import TrafficTables
from carlaloc_env.traffic.stop_lines import DEPARTURE_S, stop_lines, travel_times_s
from carlaloc_env.traffic.traffic_config import traffic_of_town

TIMING = SignalTiming(green_s=10.0, main_green_s=20.0, left_green_s=6.0)
STEP_S = 0.25


@pytest.fixture(scope="module")
def network() -> LaneNetwork:
    """Town05's lanes."""
    return town_network("Town05")


@pytest.fixture(scope="module")
def route(network: LaneNetwork) -> Route:
    """Town05's route, past three junctions with lights, each once."""
    config = TownConfig.from_toml(find_town("Town05").with_name("town.toml"))
    return plan_route(network, config.route.points, length_m=config.route.length_m)


def greens_s(plan: SignalPlan, heads: int) -> list[NDArray[np.float64]]:
    """Beginning and end of each head's first whole green [s]."""
    states = np.array([plan.at(round(k * STEP_S * 1e9)).state for k in range(1200)])
    found = []
    for head in range(heads):
        edges = STEP_S * np.flatnonzero(np.diff((states[:, head] == SignalState.GREEN).astype(int)))
        found.append(edges[int(states[0, head] == SignalState.GREEN) :][:3])
    return found


def test_a_wave_is_in_the_middle_of_green_when_its_car_comes(network: LaneNetwork, route: Route) -> None:
    """Closed form: the arrival at the pace of progression is the middle of the green of each light."""
    lines = stop_lines(network, route)
    plan = SignalPlan.from_network(network, replace(TIMING, green_wave=True), route)
    assert len(lines.s_m) == 3
    for travel_s, heads in zip(travel_times_s(route, lines.s_m).tolist(), lines.heads, strict=True):
        arrives_s = DEPARTURE_S + travel_s / PACE
        for at_s in (arrives_s - 9.5, arrives_s + 9.5):
            assert plan.at(round(at_s * 1e9)).state[heads[0]] == SignalState.GREEN


def test_junctions_of_the_route_share_a_cycle_and_others_keep_theirs(
    network: LaneNetwork, route: Route
) -> None:
    """Their longest of four phases, 2 × 20 + 2 × 6 s of green, 4 × 5 s between; main streets get the rest."""
    plan = SignalPlan.from_network(network, TIMING, route)
    green = greens_s(plan, len(network.signals))
    passed = {head for heads in stop_lines(network, route).heads for head in heads}
    own = {network.signals[head].junction_id for head in passed}
    for index, head in enumerate(network.signals):
        begins_s, ends_s, again_s = green[index]
        if head.junction_id in own:
            assert again_s - begins_s == pytest.approx(72.0, abs=STEP_S)
        else:
            assert ends_s - begins_s <= 10.0 + STEP_S
        if index in passed:
            assert ends_s - begins_s >= 20.0 - STEP_S
    assert max(green[index][1] - green[index][0] for index in passed) == pytest.approx(52.0, abs=STEP_S)


def test_progression_is_everybodys_and_not_the_egos(network: LaneNetwork, route: Route) -> None:
    """From green to green passes the platoon's time; when the first begins has nothing to do with the ego."""
    lines = stop_lines(network, route)
    arrives_s = travel_times_s(route, lines.s_m) / PACE
    middle_s = []
    for wave in (True, False):
        plan = SignalPlan.from_network(network, replace(TIMING, green_wave=wave), route)
        green = greens_s(plan, len(network.signals))
        middle_s.append(np.array([green[heads[0]][:2].mean() for heads in lines.heads]))
        late_s = (np.diff(middle_s[-1]) - np.diff(arrives_s) + 36.0) % 72.0 - 36.0
        assert np.abs(late_s).max() < 2.0 * STEP_S
    assert abs((middle_s[1] - middle_s[0])[0] % 72.0) > STEP_S


def test_each_seed_begins_at_another_second_unless_it_is_a_wave() -> None:
    town = load_town("Town03")
    timings = [traffic_of_town(town, "dynamic", seed).timing for seed in range(6)]
    assert len({timing.offset_s for timing in timings}) == 6
    assert not any(timing.green_wave for timing in timings)
    waves = [traffic_of_town(town, "dynamic,green_wave=true", seed).timing for seed in range(6)]
    assert set(waves) == {replace(town.config.signals, green_wave=True)}
    tables = TrafficTables(town.network, town.route)
    later, anew = (
        tables.signal_plan(timings[1]),
        SignalPlan.from_network(town.network, timings[1], town.route),
    )
    for second in range(0, 100, 7):
        assert (later.at(second * 10**9).state == anew.at(second * 10**9).state).all()


def test_without_a_route_cycles_begin_as_ever(network: LaneNetwork) -> None:
    plain, wave = (
        SignalPlan.from_network(network, replace(TIMING, green_wave=wave)) for wave in (False, True)
    )
    for second in range(0, 100, 7):
        assert (plain.at(second * 10**9).state == wave.at(second * 10**9).state).all()


def test_travel_on_a_straight_road_is_distance_over_the_limit(network: LaneNetwork) -> None:
    """Far from the start, each metre of a straight street takes 1 / limit."""
    straight = plan_route(network, [(250.0, 67.75), (100.0, 67.75)])
    times = travel_times_s(straight, np.array([60.0, 110.0]))
    limit = float(straight.speed_limit_mps[-1])
    assert times[1] - times[0] == pytest.approx(50.0 / limit, rel=0.1)
    assert travel_times_s(straight, np.zeros(1))[0] == 0.0
