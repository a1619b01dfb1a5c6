"""Town05: a grid of streets below a raised ring road, as its plan says."""

import pathlib
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from scipy.spatial import cKDTree
from shared_fixtures.worlds.towns import town_network

from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.routing.plan_route import plan_route
from carlaloc_env.map.routing.route import Route

FOLDER = pathlib.Path(__file__).parents[2] / "maps/Town05"
RING_M, HEIGHT_M = 520.0, 6.5


@pytest.fixture(scope="module")
def network() -> LaneNetwork:
    return town_network("Town05")


@pytest.fixture(scope="module")
def root() -> ElementTree.Element:
    return ElementTree.parse(FOLDER / "town.xodr").getroot()


@pytest.fixture(scope="module")
def route(network: LaneNetwork) -> Route:
    config = TownConfig.from_toml(FOLDER / "town.toml").route
    return plan_route(network, config.points, length_m=config.length_m)


def driving_points(network: LaneNetwork, named: str) -> np.ndarray:
    """Centre points (N, 3) of the driving lanes of plain roads whose name begins so."""
    names = {road.id: road.name for road in network.xodr.roads}
    lanes = [
        lane.index
        for lane in network.lanes
        if lane.type == "driving" and lane.junction_id is None and names[lane.road_id].startswith(named)
    ]
    owner = np.repeat(np.arange(len(network.tables.count)), network.tables.count)
    found: np.ndarray = network.tables.position_m[np.isin(owner, lanes)]
    return found


def test_ring_is_as_large_and_high_as_the_plan_says(network: LaneNetwork) -> None:
    """Its axis is 520 m square, so its outermost lanes are 520 m + 2·(1.5 + 2.5·3.5) m apart."""
    ring = driving_points(network, "Ring")
    np.testing.assert_allclose(ring[:, 2], HEIGHT_M)
    np.testing.assert_allclose(np.ptp(ring[:, :2], axis=0), RING_M + 2 * (1.5 + 2.5 * 3.5), atol=8.0)
    assert len(ring) > 10_000


def test_all_of_the_ring_between_ramps_is_a_bridge(root: ElementTree.Element) -> None:
    rings = [road for road in root.findall("road[@junction='-1']") if road.get("name", "").startswith("Ring")]
    assert len(rings) == 8
    for road in rings:
        bridge = road.find("objects/bridge")
        assert bridge is not None
        assert float(bridge.get("length", "nan")) == pytest.approx(float(road.get("length", "nan")))


def test_ramps_are_steep_but_not_too_steep(root: ElementTree.Element) -> None:
    """Eight ramps of one lane of 4 m that take the whole height at 5.5 to 7 %."""
    ramps = [road for road in root.findall("road[@junction='-1']") if road.get("name", "").startswith("Ramp")]
    assert len(ramps) == 8
    for road in ramps:
        records = road.findall("elevationProfile/elevation")
        grades = [abs(float(record.get("b", "nan"))) for record in records]
        assert 0.055 < max(grades) < 0.07
        heights = [float(records[0].get("a", "nan")), float(records[-1].get("a", "nan"))]
        assert abs(heights[1] - heights[0]) > 0.8 * HEIGHT_M
        lanes = [lane for lane in road.iter("lane") if lane.get("type") == "driving"]
        assert [float(w.get("a", "nan")) for w in lanes[0].findall("width")] == [4.0]
        assert len(lanes) == 1


def test_the_drive_passes_twice_below_the_ring(network: LaneNetwork, route: Route) -> None:
    """Roads above it leave more than 5 m below their decks of 0.9 m."""
    above = network.tables.position_m[network.tables.position_m[:, 2] > 3.0]
    distance, nearest = cKDTree(above[:, :2]).query(route.position_m[:, :2])
    below = distance < 1.5
    assert (above[nearest[below], 2] - route.position_m[below, 2]).min() > 5.0 + 0.9
    axis = np.abs(route.position_m[:, :2]).max(axis=1) - RING_M / 2
    passes = np.flatnonzero(np.diff(np.sign(axis)))
    assert len(passes) == 2
    assert below[passes].all()


def test_lights_have_two_or_four_phases(root: ElementTree.Element) -> None:
    """Four at the inner crossings with their pockets, two at the others; signs where quays meet ramps."""
    phases = {
        junction.get("name"): len({c.get("sequence") for c in junction.findall("controller")})
        for junction in root.findall("junction")
    }
    assert {name for name, count in phases.items() if count == 4} == {"B2", "B3", "C2", "C3"}
    assert sum(count == 2 for count in phases.values()) == 10
    assert len(phases) == 14 + 4 + 8


def test_size_is_that_of_the_plan(network: LaneNetwork) -> None:
    driving = [lane for lane in network.lanes if lane.type == "driving"]
    assert sum(lane.length_m for lane in driving) > 24_000.0
