"""Demand for lanes: main streets are those of the route, and the stream runs towards it."""

import itertools

import numpy as np
import pytest
from shared_fixtures.worlds.towns import town_network

from benchmarks.traffic_audit import NOBODY
from carlaloc_env.core import clock
from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.routing.plan_route import plan_route
from carlaloc_env.map.routing.route import Route
from carlaloc_env.map.sources import find_town
from carlaloc_env.traffic.standing_traffic import TrafficTables
from carlaloc_env.traffic.tables.lane_demand import (
    MAIN_STREET_DEMAND,
    ROUTE_DEMAND,
    STREET_REACH_M,
    lane_demand,
    weighted_order,
)
from carlaloc_env.traffic.traffic_config import TrafficConfig
from carlaloc_env.traffic.world import TrafficWorld


@pytest.fixture(scope="module")
def network() -> LaneNetwork:
    """Town05's lanes: a grid, with a ring on stilts."""
    return town_network("Town05")


@pytest.fixture(scope="module")
def route(network: LaneNetwork) -> Route:
    """Along one street of the grid, 200 m to the west."""
    return plan_route(network, [(250.0, 67.75), (60.0, 67.75)])


def test_the_stream_runs_towards_the_route(network: LaneNetwork, route: Route) -> None:
    """Lanes of the street against the route carry more than lanes with it, and other streets as before."""
    demand = lane_demand(network, route.position_m)
    assert (demand >= 1.0).all()
    assert (demand <= MAIN_STREET_DEMAND).all()
    kinds = set()
    for index, lane in enumerate(network.lanes):
        if lane.type != "driving" or lane.junction_id is not None:
            continue
        rows = slice(network.tables.first[index], network.tables.first[index] + network.tables.count[index])
        points, heading = network.tables.position_m[rows], network.tables.heading_rad[rows]
        away = np.linalg.norm(points[:, None] - route.position_m[None, ::4], axis=-1).min(axis=1)
        if away.min() > STREET_REACH_M + 1.0:
            assert demand[index] == pytest.approx(1.0)
            kinds.add("elsewhere")
        elif away.max() < STREET_REACH_M - 9.0:
            against = np.cos(heading).mean() > 0.9  # the route heads west
            assert demand[index] == pytest.approx(MAIN_STREET_DEMAND if against else ROUTE_DEMAND)
            kinds.add("against" if against else "along")
    assert kinds == {"elsewhere", "against", "along"}


def test_without_a_route_no_street_is_a_main_street(network: LaneNetwork) -> None:
    assert (lane_demand(network, None) == 1.0).all()


def test_weighted_order_follows_its_theory() -> None:
    """Plackett and Luce: a thing comes first by its share of all weights, then by its share of the rest."""
    weight = np.array([1.0, 2.0, 5.0])
    draw = clock.stream(3, "order")
    count = 20_000
    orders = [tuple(weighted_order(draw, weight).tolist()) for _ in range(count)]
    for order in itertools.permutations(range(3)):
        a, b, _ = order
        expected = weight[a] / 8.0 * weight[b] / (8.0 - weight[a])
        share = orders.count(order) / count
        assert share == pytest.approx(expected, abs=4.0 * np.sqrt(expected / count))


def test_people_keep_to_the_sidewalks_of_main_streets(network: LaneNetwork) -> None:
    """Most who set out beside the town's route are still near two minutes later; without a route few are."""
    points = TownConfig.from_toml(find_town("Town05").with_name("town.toml")).route.points
    route = plan_route(network, points)
    near = {}
    for name, wanted in (("busy", route), ("even", None)):
        world = TrafficWorld(
            network, TrafficConfig(vehicles=0, walkers=44, seed=2), TrafficTables(network, wanted)
        )
        frame = world.reset()
        for _ in range(120 * 20):
            frame = world.step(NOBODY)
        away = np.linalg.norm(frame.position_m[:, None, :2] - route.position_m[None, ::4, :2], axis=-1)
        near[name] = float((away.min(axis=1) < STREET_REACH_M).mean())
    assert near["busy"] > 0.5
    assert near["even"] < 0.4
