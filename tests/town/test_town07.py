"""Town07: the heights and the mix of junctions that make it arable land."""

import pathlib
import xml.etree.ElementTree as ElementTree
from collections import Counter

import numpy as np
import pytest
from shared_fixtures.worlds.towns import town_network

from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.routing.plan_route import plan_route

FOLDER = pathlib.Path(__file__).parents[2] / "maps/Town07"


@pytest.fixture(scope="module")
def network() -> LaneNetwork:
    return town_network("Town07")


def test_size_and_heights_are_those_of_the_plan(network: LaneNetwork) -> None:
    """290 m by 370 m, about 8 lane-km from −0.7 m to 8.8 m, no steeper than 9.7 %."""
    driving = [lane.index for lane in network.lanes if lane.type == "driving"]
    owner = np.repeat(np.arange(len(network.tables.count)), network.tables.count)
    low, high = (f(network.tables.position_m[np.isin(owner, driving)], axis=0) for f in (np.min, np.max))
    np.testing.assert_allclose((high - low)[:2], [290.0, 370.0], rtol=0.04)
    assert low[2] == pytest.approx(-0.7, abs=0.2)
    assert high[2] == pytest.approx(8.8, abs=0.2)
    assert sum(network.lanes[i].length_m for i in driving) > 7000.0
    config = TownConfig.from_toml(FOLDER / "town.toml").route
    route = plan_route(network, config.points, length_m=config.length_m)
    assert np.ptp(route.position_m[:, 2]) > 8.0
    assert 0.05 < np.abs(route.slope).max() < 0.097


def test_junctions_are_those_of_the_plan() -> None:
    """26 T-junctions, three crossings, two turning loops; lights at one of them, signs at the others."""
    root = ElementTree.parse(FOLDER / "town.xodr").getroot()
    legs = Counter(
        len({c.get("incomingRoad") for c in junction.findall("connection")})
        for junction in root.findall("junction")
    )
    assert legs == {3: 26, 4: 3, 1: 2}
    lit = [junction for junction in root.findall("junction") if junction.find("controller") is not None]
    assert len(lit) == 1
    signs = Counter(signal.get("type") for signal in root.iter("signal"))
    assert signs["206"] > 10
    assert signs["205"] > 10


def test_lanes_are_narrow_and_mostly_unmarked() -> None:
    root = ElementTree.parse(FOLDER / "town.xodr").getroot()
    widths, marks = set(), Counter[str]()
    for road in root.findall("road[@junction='-1']"):
        for lane in road.iter("lane"):
            if lane.get("type") == "driving":
                widths |= {float(w.get("a", "nan")) for w in lane.findall("width")}
                marks[lane.findall("roadMark")[0].get("type", "")] += 1
        centre = road.find("lanes/laneSection/center/lane/roadMark")
        assert centre is not None
        assert centre.get("type") == "none"
    assert min(widths) == 3.1
    assert max(widths) == 3.5
    assert marks["none"] > marks["solid"] > 0
