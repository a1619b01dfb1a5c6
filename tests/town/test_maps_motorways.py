"""Town04 and Town06: what each is known for, and exits drawn as the plain roads that they are."""

import pathlib

import numpy as np
import pytest
import shapely
from shared_fixtures.worlds.towns import town_network

from carlaloc_env.core.areas import union
from carlaloc_env.map.config import TownConfig
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.lanes.lanes import Lane
from carlaloc_env.map.routing.plan_route import plan_route
from carlaloc_env.scenery.ground.lane_strips import Strip, road_strips
from carlaloc_env.scenery.ground.paved_areas import lane_area, town_areas

MAPS = pathlib.Path(__file__).parents[2] / "maps"


def network_of(name: str) -> LaneNetwork:
    return town_network(name)


@pytest.fixture(scope="module")
def town04() -> LaneNetwork:
    return network_of("Town04")


@pytest.fixture(scope="module")
def town06() -> LaneNetwork:
    return network_of("Town06")


def driving(network: LaneNetwork) -> list[Lane]:
    return [lane for lane in network.lanes if lane.type == "driving"]


def road_names(network: LaneNetwork) -> dict[str, str]:
    return {road.id: road.name for road in network.xodr.roads}


@pytest.mark.parametrize(("name", "lane_km", "junctions"), [("Town04", 33.8, 27), ("Town06", 25.9, 23)])
def test_size(name: str, lane_km: float, junctions: int) -> None:
    """At least as much road and as many junctions as CARLA's own towns of these names."""
    network = network_of(name)
    assert sum(lane.length_m for lane in driving(network)) / 1000 > lane_km
    assert len(network.xodr.junctions) >= junctions


def test_town04_crosses_itself(town04: LaneNetwork) -> None:
    """One circuit passes over and under the middle, 6.6 m apart, and every other lane is as long."""
    config = TownConfig.from_toml(MAPS / "Town04" / "town.toml").route
    route = plan_route(town04, config.points, loop=True)
    middle = np.hypot(*route.position_m[:, :2].T) < 9.0
    z = route.position_m[middle, 2]
    assert (z.min(), z.max()) == pytest.approx((-3.3, 3.3), abs=0.02)
    assert np.abs(route.slope).max() <= 0.05
    # The outer lanes of one lobe are the inner lanes of the other: all four lanes are one length.
    names = road_names(town04)
    for lane_id in (-1, -3, -4):
        named = [lane for lane in driving(town04) if lane.lane_id == lane_id]
        own = [lane for lane in named if names[lane.road_id].startswith(("Motorway A", "East o", "West i"))]
        own = [lane for lane in own if not names[lane.road_id].endswith((" ramp", " off", " on"))]
        length = sum(lane.length_m for lane in own)
        assert length == pytest.approx(2108.0, abs=1.0)


def test_town04_has_two_interchanges(town04: LaneNetwork) -> None:
    """Eight slip roads: every ramp's junction has one entry lane, and the ramps climb to the bridges."""
    names = road_names(town04)
    ramps = [lane for lane in driving(town04) if names[lane.road_id].endswith(" ramp")]
    assert len(ramps) == 8
    slips = [lane for lane in driving(town04) if names[lane.road_id].split(" ")[-1] in ("off", "on")]
    rises = [np.ptp(network_heights(town04, lane)) for lane in slips if lane.junction_id is None]
    assert len(rises) == 8
    assert min(rises) > 6.0


def network_heights(network: LaneNetwork, lane: Lane) -> np.ndarray:
    stations = np.linspace(0.0, lane.length_m, 20)
    z: np.ndarray = network.pose(np.full(20, lane.index), stations).position_m[:, 2]
    return z


def test_town06_is_wide_and_turns_back(town06: LaneNetwork) -> None:
    """Up to eight lanes abreast, two crossovers that turn by half a circle, three gores, two closes."""
    names = road_names(town06)
    widest = {}
    for lane in driving(town06):
        if lane.junction_id is None:
            key = (lane.road_id, lane.section)
            widest[key] = widest.get(key, 0) + 1
    assert max(widest.values()) == 8  # three lanes each way, a pocket and an auxiliary lane
    turns = [lane for lane in driving(town06) if "U-turn" in names[lane.road_id]]
    assert len(turns) == 2
    for lane in turns:
        ends = town06.pose([lane.index, lane.index], [0.0, lane.length_m])
        assert np.cos(ends.heading_rad[1] - ends.heading_rad[0]) == pytest.approx(-1.0, abs=1e-6)
    assert sum(names[lane.road_id].endswith(" ramp") for lane in driving(town06)) == 3
    assert sum(names[lane.road_id].endswith(" bulb") for lane in driving(town06)) == 2


def test_exits_are_drawn_as_plain_roads(town06: LaneNetwork) -> None:
    """Their strips name no junction and tile the ground: nothing overlaps, nothing is left open between."""
    strips = road_strips(town06.xodr.roads, town06.surface)
    names = road_names(town06)
    gores = {lane.junction_id for lane in driving(town06) if names[lane.road_id].endswith("ramp")}
    inside = {road.id for road in town06.xodr.roads if road.junction_id in gores}
    assert len(gores) == 3
    assert all(strip.junction_id is None for strip in strips if strip.road_id in inside)
    left = {strip.junction_id for strip in strips} - {None}
    assert len(left) == len(town06.xodr.junctions) - 3
    areas = town_areas(strips, town06.xodr.roads)
    assert {area.id for area in areas.junctions} == left
    assert not (gores & left)


def test_nothing_opens_between_road_and_ramp(town06: LaneNetwork) -> None:
    """Closing every slit narrower than a metre adds less than a square metre to an exit's surface."""
    names = road_names(town06)
    strips = [s for s in road_strips(town06.xodr.roads, town06.surface) if names[s.road_id].startswith("X ")]
    assert {names[strip.road_id] for strip in strips} == {"X through", "X ramp"}
    for own in (names_of(strips, names, "X through"), strips):
        surface = union(area for strip in own for area in lane_area(strip, ("roadway", "median")))
        closed = shapely.buffer(shapely.buffer(surface, 0.5, join_style="mitre"), -0.5, join_style="mitre")
        assert closed.area - surface.area < 1.0
    parts = [union(lane_area(strip, ("roadway", "median"))) for strip in strips]
    assert sum(part.area for part in parts) - union(parts).area < 1.0


def names_of(strips: list[Strip], names: dict[str, str], name: str) -> list[Strip]:
    return [strip for strip in strips if names[strip.road_id] == name]
