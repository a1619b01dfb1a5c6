"""Traffic tables that come from the cache are those worked out anew, to the last bit."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.worlds.equality import assert_same
from shared_fixtures.worlds.small_towns import Built, straight_road

from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.map.config import SignalTiming, TownConfig
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.opendrive.reader import read_opendrive
from carlaloc_env.map.roads import TownRoads, build_roads
from carlaloc_env.map.sources import find_town
from carlaloc_env.scene.signal_lenses import SignalLenses
from carlaloc_env.scenery.outline import TownOutline
from carlaloc_env.town.town import Town
from carlaloc_env.traffic.signals import SignalPlan
from carlaloc_env.traffic.standing_traffic import TrafficTables, kept_tables

PARTS = ("roads", "walker_network", "cells", "overlaps")


def town_of(name: str, roads: TownRoads) -> Town:
    """A town without scenery."""
    nothing = np.zeros((0, 3))
    outline = TownOutline(
        collision_vertices_m=nothing,
        collision_triangles=nothing.astype(np.int32),
        collision_tags=np.zeros(0, np.uint8),
        lenses=SignalLenses(),
        road_events=np.zeros((0, 7)),
        lamps_m=nothing,
    )
    return Town(name=name, config=TownConfig(), roads=roads, outline=outline, scenery=tuple)


def plain(network: LaneNetwork) -> TownRoads:
    """Roads without a route."""
    return TownRoads(network=network, geo=GeoReference(latitude_deg=0.0, longitude_deg=0.0))


def packaged(name: str) -> Town:
    """A packaged town without scenery."""
    source = find_town(name)
    config = TownConfig.from_toml(source.with_name("town.toml"))
    roads = build_roads(read_opendrive(source), config, 3)
    return town_of(name, roads)


def assert_same_tables(a: TrafficTables, b: TrafficTables) -> None:
    for part in PARTS:
        assert_same(getattr(a, part), getattr(b, part), part)
    none = np.zeros((0, 3))
    assert_same(a.starting_positions(5, none), b.starting_positions(5, none))


@pytest.mark.parametrize("name", ["Town01", "Town03"])
def test_kept_tables_are_those_worked_out_anew(name: str, tmp_path: Path) -> None:
    town = packaged(name)
    anew = TrafficTables(town.network, town.route)
    for _ in range(2):
        assert_same_tables(kept_tables(town, folder=tmp_path), anew)
    assert len(list(tmp_path.glob(f"{name}-*.traffic"))) == 1


def test_so_are_those_of_small_maps(river: Built, motorway: Built, tmp_path: Path) -> None:
    """Without a route, signals or crosswalks, and without sidewalks."""
    for name, built in (("river", river), ("motorway", motorway)):
        town = town_of(name, plain(built.network))
        anew = TrafficTables(built.network)
        for _ in range(2):
            assert_same_tables(kept_tables(town, folder=tmp_path), anew)


def test_another_route_and_other_lanes_have_other_tables(tmp_path: Path) -> None:
    """Also under the same name: the file is named after all that its tables come from."""
    town = packaged("Town01")
    first = kept_tables(town, folder=tmp_path)
    second = kept_tables(replace(town, roads=replace(town.roads, route=None)), folder=tmp_path)
    assert not np.array_equal(first.roads.lane.demand, second.roads.lane.demand)
    assert_same_tables(second, TrafficTables(town.network))
    lanes = (("driving", 3.5), ("sidewalk", 2.5))
    road = straight_road(1, (0.0, 0.0, 0.0), 120.0, ((0, 0, 0, 0, 0),), lanes)
    network = build_network(f"<OpenDRIVE><header/>{road}</OpenDRIVE>".encode())
    third = kept_tables(town_of("Town01", plain(network)), folder=tmp_path)
    assert_same_tables(third, TrafficTables(network))
    assert len(list(tmp_path.glob("Town01-*.traffic"))) == 3


def test_damaged_tables_are_worked_out_again(tmp_path: Path) -> None:
    town = packaged("Town01")
    kept_tables(town, folder=tmp_path)
    (file,) = tmp_path.glob("*.traffic")
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 0x40
    file.write_bytes(content)
    assert_same_tables(kept_tables(town, folder=tmp_path), TrafficTables(town.network, town.route))


def test_signals_follow_the_same_plan(tmp_path: Path) -> None:
    """The demand that tables keep is the one that a plan would work out itself."""
    town, timing = packaged("Town03"), SignalTiming()
    plan = kept_tables(town, folder=tmp_path).signal_plan(timing)
    anew = SignalPlan.from_network(town.network, timing, town.route)
    for second in range(0, 200, 7):
        assert_same(plan.at(second * 10**9).state, anew.at(second * 10**9).state)
