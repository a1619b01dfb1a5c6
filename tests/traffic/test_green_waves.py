"""Green waves: lights along a town's route let a car pass that sets out with the drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from carlaloc_env.town.config import SignalTiming, TownConfig
from carlaloc_env.town.lanes.build_network import build_network
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.town.routing.route import Route, plan_route
from carlaloc_env.town.sources import find_town
from carlaloc_env.traffic.signals import SignalPlan, SignalState
from carlaloc_env.traffic.stop_lines import DEPARTURE_S, PACE, arrival_times_s, stop_lines

TIMING = SignalTiming(green_s=10.0, main_green_s=20.0, left_green_s=6.0)


@pytest.fixture(scope="module")
def network() -> LaneNetwork:
    """Town05's lanes."""
    return build_network(find_town("Town05"))


@pytest.fixture(scope="module")
def route(network: LaneNetwork) -> Route:
    """Town05's route, past three junctions with lights, each once."""
    config = TownConfig.from_toml(find_town("Town05").with_name("town.toml"))
    return plan_route(network, config.route.points, length_m=config.route.length_m)


def green_before_and_after_s(plan: SignalPlan, head: int, at_s: float) -> tuple[float, float]:
    """For how long a head has been green at a time, and for how much longer it will be [s]."""

    def run(sign: int) -> float:
        for k in range(2000):
            if plan.state_at(round((at_s + sign * 0.05 * k) * 1e9))[head] != SignalState.GREEN:
                return 0.05 * k
        return np.inf

    return run(-1), run(1)


def test_a_car_of_the_wave_meets_green(network: LaneNetwork, route: Route) -> None:
    """It arrives when the queue has left, half of twenty seconds into the green, at every light."""
    lines = stop_lines(network, route)
    plan = SignalPlan.from_network(network, TIMING, route)
    assert len(lines.s_m) == 3
    for arrival_s, heads in zip(arrival_times_s(route, lines.s_m), lines.heads, strict=True):
        before, after = green_before_and_after_s(plan, heads[0], float(arrival_s))
        assert before == pytest.approx(10.0, abs=0.3)
        assert after == pytest.approx(10.0, abs=0.3)


def test_without_the_wave_or_a_route_cycles_begin_as_ever(network: LaneNetwork, route: Route) -> None:
    equal = replace(TIMING, main_green_s=None)
    plain = SignalPlan.from_network(network, equal)
    without = SignalPlan.from_network(network, replace(equal, green_wave=False), route)
    for second in range(0, 100, 7):
        now = second * 1_000_000_000
        assert (plain.state_at(now) == without.state_at(now)).all()


def test_main_streets_have_the_longer_green(network: LaneNetwork, route: Route) -> None:
    """Of a junction on the route its own phases have 20 s; junctions elsewhere none."""
    plan = SignalPlan.from_network(network, TIMING, route)
    step_s = 0.25
    states = np.array([plan.state_at(round(k * step_s * 1e9)) for k in range(1200)])
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


def test_arrival_on_a_straight_road_is_distance_over_pace(network: LaneNetwork) -> None:
    """Far from the start, each metre of a straight street takes 1 / (pace · limit)."""
    straight = plan_route(network, [(250.0, 67.75), (100.0, 67.75)])
    s = np.array([60.0, 110.0])
    times = arrival_times_s(straight, s)
    limit = float(straight.speed_limit_mps[-1])
    assert times[1] - times[0] == pytest.approx(50.0 / (PACE * limit), rel=0.1)
    assert arrival_times_s(straight, np.zeros(1))[0] == pytest.approx(DEPARTURE_S)
