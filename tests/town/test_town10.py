"""Town10: boulevards, a promenade and junctions of many kinds, as its plan says."""

import pathlib
import xml.etree.ElementTree as ElementTree

import gymnasium as gym
import numpy as np
import pytest
import shapely
from shared_fixtures.worlds.towns import town_network

from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.routing.plan_route import plan_route
from carlaloc_env.map.sources import find_town

FOLDER = pathlib.Path(__file__).parents[2] / "maps/Town10"


@pytest.fixture(scope="module")
def network() -> LaneNetwork:
    return town_network("Town10")


@pytest.fixture(scope="module")
def root() -> ElementTree.Element:
    return ElementTree.parse(FOLDER / "town.xodr").getroot()


def test_two_names_lead_to_it() -> None:
    assert find_town("Town10HD") == find_town("Town10")
    assert {"CarlaLoc-Town10-v0", "CarlaLoc-Town10HD-v0"} <= set(gym.registry)


def test_size_is_that_of_the_plan(network: LaneNetwork) -> None:
    """At least half of CARLA's 6.1 lane-km and all of its nine junctions, within a metre of level."""
    driving = [lane.index for lane in network.lanes if lane.type == "driving"]
    assert sum(network.lanes[i].length_m for i in driving) > 6000.0
    assert len({network.lanes[i].junction_id for i in driving} - {None}) == 9
    owner = np.repeat(np.arange(len(network.tables.count)), network.tables.count)
    height = network.tables.position_m[np.isin(owner, driving), 2]
    assert height.min() >= -1e-6
    assert height.max() <= 1.0


def test_junctions_are_of_many_kinds(root: ElementTree.Element) -> None:
    """Four phases at the protected crossing, two at the staggered one, two and three at T-junctions.

    One where only people on foot stop the traffic; signs elsewhere.
    """
    phases = {}
    for junction in root.findall("junction"):
        sequences = {c.get("sequence") for c in junction.findall("controller")}
        phases[junction.get("name")] = len(sequences)
    assert phases["C"] == 4
    assert phases["N"] == phases["W"] == 2
    assert phases["S"] == phases["E"] == 3  # both directions, the left turn across, the stem
    assert phases["P"] == 1
    assert phases["TN"] == phases["TE"] == phases["TW"] == 0


def test_legs_of_the_staggered_crossing_do_not_face_each_other(network: LaneNetwork) -> None:
    """Who drives north across Opera Boulevard leaves it 9 m further east, less half the median."""
    inside = [lane for lane in network.lanes if lane.type == "driving" and lane.junction_id is not None]
    aside = []
    for lane in inside:
        pose = network.pose([lane.index] * 2, [0.0, lane.length_m])
        if np.all(np.abs(pose.heading_rad - np.pi / 2) < 1e-3):
            aside.append(pose.position_m[1, 0] - pose.position_m[0, 0])
    assert max(aside) == pytest.approx(9.0 - 1.5, abs=0.01)


def test_the_promenade_lies_between_road_and_water(root: ElementTree.Element) -> None:
    """Nine metres wide; the water begins within it and no lane lies in the water."""
    widths = [
        float(width.get("a", "nan"))
        for road in root.findall("road[@junction='-1']")
        if road.get("name", "").startswith("Harbour")
        for lane in road.iter("lane")
        if lane.get("type") == "sidewalk"
        for width in lane.findall("width")
    ]
    assert set(widths) == {5.0, 9.0}
    water = next(z for z in TownConfig.from_toml(FOLDER / "town.toml").zones if z.kind == "water")
    harbour = shapely.Polygon(water.polygon)
    network = town_network("Town10")
    for lane in network.lanes:
        line = network.pose([lane.index] * 9, np.linspace(0.0, lane.length_m, 9)).position_m[:, :2]
        gap = shapely.distance(harbour, shapely.points(line)).min()
        assert gap > (7.0 if lane.type == "driving" else 0.0)


def test_the_drive_goes_round_the_town_and_its_harbour_block() -> None:
    """Two full turns to the right; the harbour block's outer sides are driven twice."""
    network = town_network("Town10")
    config = TownConfig.from_toml(FOLDER / "town.toml").route
    route = plan_route(network, config.points, loop=True)
    turned = np.unwrap(np.append(route.heading_rad, route.heading_rad[0]))
    assert turned[-1] - turned[0] == pytest.approx(-4 * np.pi, abs=1e-6)
    twice = np.hypot(*(route.position_m[:, :2] - [-60.0, -99.05]).T) < 0.6
    assert np.count_nonzero(np.diff(twice.astype(int)) == 1) == 2


def test_a_slip_leads_right_round_an_island(root: ElementTree.Element, network: LaneNetwork) -> None:
    """At E a third lane leaves Exchange Avenue for the outer lane of Market Boulevard, for itself alone.

    Between its way and those of the others lies an island of more than 90 m².
    """
    names = {road.id: road.name for road in network.xodr.roads}
    (slip,) = [lane for lane in network.lanes if names[lane.road_id] == "E right from Exchange Av"
               and lane.type == "driving"]  # fmt: skip
    (before,), (after,) = slip.predecessors, slip.successors
    assert network.lanes[before].successors == (slip.index,)
    assert network.lanes[after].predecessors == (slip.index,)
    beside = [lane for lane in network.lanes if lane.road_id == network.lanes[before].road_id
              and lane.section == network.lanes[before].section and lane.type == "driving"]  # fmt: skip
    assert sum(lane.lane_id > 0 for lane in beside) == 3
    ways = []
    for lane in network.lanes:
        if lane.junction_id == slip.junction_id and lane.type == "driving":
            station = np.linspace(0.0, lane.length_m, 40)
            line = network.pose([lane.index] * 40, station).position_m[:, :2]
            ways.append(shapely.buffer(shapely.LineString(line), 1.8, cap_style="flat"))
    rest = shapely.difference(shapely.box(72.0, -17.0, 113.0, 33.0), shapely.union_all(ways))
    (island,) = (part for part in shapely.get_parts(rest) if shapely.contains_xy(part, 93.0, 10.0))
    assert 90.0 < island.area < 200.0
