"""Town01: the river town's bridges lie over its river."""

import pathlib
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
import shapely
from shared_fixtures.worlds.towns import town_network

from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.lanes.lane_network import LaneNetwork

FOLDER = pathlib.Path(__file__).parents[2] / "maps/Town01"


@pytest.fixture(scope="module")
def network() -> LaneNetwork:
    return town_network("Town01")


def test_four_bridges_span_the_whole_river(network: LaneNetwork) -> None:
    """Wherever a lane's centre lies over water, it lies on one of four bridges, with 4 m to spare."""
    water = shapely.union_all(
        [
            shapely.Polygon(z.polygon)
            for z in TownConfig.from_toml(FOLDER / "town.toml").zones
            if z.kind == "water"
        ]
    )
    root = ElementTree.parse(FOLDER / "town.xodr").getroot()
    spans = {
        road.get("id"): (float(bridge.get("s", "nan")), float(bridge.get("length", "nan")))
        for road in root.findall("road")
        for bridge in road.findall("objects/bridge")
    }
    assert len(spans) == 4
    wet = set()
    for lane in network.lanes:
        station = np.arange(0.0, lane.length_m, 0.5)
        place = network.pose(np.full(len(station), lane.index), station).position_m
        over = shapely.intersects_xy(water, place[:, 0], place[:, 1])
        if over.any():
            wet.add(lane.road_id)
            start, length = spans[lane.road_id]
            # The roads over the river are straight and run north or south through y = 0.
            assert np.abs(place[over, 1]).max() < length / 2 - 4.0
            middle = network.pose([lane.index], [start + length / 2]).position_m[0]
            assert middle[1] == pytest.approx(0.0, abs=0.01)
    assert wet == set(spans)


def test_it_is_flat_and_has_twelve_lights_of_three_phases(network: LaneNetwork) -> None:
    driving = [lane.index for lane in network.lanes if lane.type == "driving"]
    owner = np.repeat(np.arange(len(network.tables.count)), network.tables.count)
    assert np.ptp(network.tables.position_m[np.isin(owner, driving), 2]) == 0.0
    root = ElementTree.parse(FOLDER / "town.xodr").getroot()
    phases = [len({c.get("sequence") for c in j.findall("controller")}) for j in root.findall("junction")]
    assert phases == [3] * 12
    assert 5500.0 < sum(network.lanes[i].length_m for i in driving) < 7000.0
