"""Platoons: on motorways traffic comes in groups with empty road between, in town it does not."""

import numpy as np
import pytest
from shared_fixtures.worlds.towns import town_network

from carlaloc_env.core.array_types import Array
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.traffic.standing_traffic import SPACING_M, TrafficTables

VEHICLES = 296


@pytest.fixture(scope="module")
def network() -> LaneNetwork:
    """Town04's lanes: a motorway round a small town."""
    return town_network("Town04")


def company(network: LaneNetwork, limit_mps: tuple[float, float]) -> tuple[float, float]:
    """Of vehicles on lanes within limits: fraction with another one slot away, and of slots taken."""
    lanes, stations = TrafficTables(network).starting_positions(3, np.zeros((0, 3)))

    def fast(count: int) -> Array:
        limit = network.speed_limit_mps(lanes[:count], stations[:count])
        return np.flatnonzero((limit > limit_mps[0]) & (limit < limit_mps[1]))

    chosen, slots = fast(VEHICLES), fast(len(lanes))
    same = lanes[chosen][:, None] == lanes[chosen]
    away = np.abs(stations[chosen][:, None] - stations[chosen])
    beside = (same & (np.abs(away - SPACING_M) < 0.1)).any(axis=1)
    return float(beside.mean()), len(chosen) / len(slots)


def test_vehicles_start_in_platoons_on_motorways(network: LaneNetwork) -> None:
    in_company, taken = company(network, (19.4, 99.0))
    assert taken < 0.4
    assert in_company > 0.85


def test_vehicles_start_one_by_one_in_town(network: LaneNetwork) -> None:
    """Two slots beside each are taken by chance, no more often than lots fall."""
    in_company, taken = company(network, (0.0, 19.3))
    by_chance = 1.0 - (1.0 - taken) ** 2
    assert in_company == pytest.approx(by_chance, abs=0.15)
