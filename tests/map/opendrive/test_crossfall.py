"""Crossfall and relief of roads: where they lie, and that nothing steps where roads meet."""

import numpy as np
import pytest
from shared_fixtures.worlds.single_roads import road

from carlaloc_env import TOWNS
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.opendrive.crossfall import FADE_M, FALL, GUTTER_FALL
from carlaloc_env.map.opendrive.records import Cubic
from carlaloc_env.map.opendrive.road_surface import RoadSurface
from carlaloc_env.map.sources import find_town
from carlaloc_env.road.road_profile import LevelGrid, Relief
from carlaloc_env.road.rough_surface import class_level

SMOOTH = Relief(1, LevelGrid.uniform(0.0))
"""No undulation, so that what is left is the crossfall alone."""
_LEVEL = Cubic(0.0, 0.0, 0.0, 0.0, 0.0)


def height(surface: RoadSurface, s_m: float, t_m: float) -> float:
    return float(surface.position(np.array([0]), np.array([s_m]), np.array([t_m]))[0, 2])


def test_a_carriageway_falls_to_its_edges_and_no_farther() -> None:
    """2.5 % from lane 0 to the edge of what is driven on; what lies behind it is level."""
    lanes = (
        '<laneSection s="0">'
        '<left><lane id="1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></left>'
        '<center><lane id="0" type="none"/></center>'
        '<right><lane id="-1" type="driving"><width sOffset="0" a="3.0" b="0" c="0" d="0"/></lane>'
        '<lane id="-2" type="sidewalk"><width sOffset="0" a="2.0" b="0" c="0" d="0"/></lane></right>'
        "</laneSection>"
    )
    surface = RoadSurface(road("<line/>", 80.0, lanes=lanes).roads, SMOOTH)
    assert [height(surface, 40.0, t) for t in (0.0, 2.0, 3.5, -1.0, -3.0, -5.0)] == pytest.approx(
        [0.0, -2.0 * FALL, -3.5 * FALL, -1.0 * FALL, -3.0 * FALL, -3.0 * FALL], abs=1e-9
    )
    assert height(RoadSurface(road("<line/>", 80.0, lanes=lanes).roads), 40.0, 3.0) == 0.0


def test_a_gutter_falls_more_than_its_carriageway() -> None:
    """A shoulder that narrows from 0.5 to 0.3 m before a kerb; its slopes are those of its heights."""
    lanes = (
        '<laneSection s="0"><center><lane id="0" type="none"/></center>'
        '<right><lane id="-1" type="driving"><width sOffset="0" a="3.0" b="0.01" c="0" d="0"/></lane>'
        '<lane id="-2" type="shoulder"><width sOffset="0" a="0.5" b="-0.0025" c="0" d="0"/></lane>'
        '<lane id="-3" type="sidewalk"><width sOffset="0" a="2.0" b="0" c="0" d="0"/></lane></right>'
        "</laneSection>"
    )
    surface = RoadSurface(road("<line/>", 80.0, lanes=lanes).roads, SMOOTH)
    assert [height(surface, 40.0, t) for t in (-3.0, -3.4, -3.6, -3.8, -5.0)] == pytest.approx(
        [-3.0 * FALL, -3.4 * FALL] + [-3.4 * FALL - over * GUTTER_FALL for over in (0.2, 0.4, 0.4)], abs=1e-9
    )
    for t in (-2.0, -3.6, -5.0):
        along, askew = (
            surface.curve(np.array([0]), np.array([40.0]), (np.array([t]), np.array([t1]), np.zeros(1)))
            for t1 in (0.0, 1.0)
        )
        rise = height(surface, 40.5, t) - height(surface, 39.5, t)
        aside = (height(surface, 40.0, t + 0.05) - height(surface, 40.0, t - 0.05)) / 0.1
        assert along.slope[0] * along.stretch[0] == pytest.approx(rise, abs=1e-6)
        assert askew.slope[0] * askew.stretch[0] == pytest.approx(rise + aside, abs=1e-6)


def test_a_road_that_the_map_tilts_stays_as_it_is() -> None:
    tilted = road("<line/>", 80.0, lateral='<superelevation s="0" a="0.03" b="0" c="0" d="0"/>').roads
    for t in (-3.0, 0.0, 2.0):
        assert height(RoadSurface(tilted, SMOOTH), 40.0, t) == height(RoadSurface(tilted), 40.0, t)


@pytest.fixture(scope="module", params=TOWNS)
def networks(request: pytest.FixtureRequest) -> tuple[LaneNetwork, LaneNetwork]:
    """A town as its file has it, and with relief of class B."""
    path = find_town(request.param)
    return build_network(path), build_network(path, Relief(7, LevelGrid.uniform(class_level("B"))))


def test_no_step_where_lanes_follow_each_other(networks: tuple[LaneNetwork, LaneNetwork]) -> None:
    """Ends of driving lanes meet as well as they do in the file."""
    plain, rough = networks
    gaps = []
    for network in (plain, rough):
        z, first = network.tables.position_m[:, 2], network.tables.first
        last = first + network.tables.count - 1
        gaps.append(
            [
                abs(z[last[lane.index]] - z[first[after]])
                for lane in network.lanes
                if lane.type == "driving"
                for after in lane.successors
            ]
        )
    assert np.max(np.array(gaps[1]) - gaps[0]) < 1e-3


def test_slopes_of_lanes_are_those_of_their_heights(networks: tuple[LaneNetwork, LaneNetwork]) -> None:
    tables = networks[1].tables
    step = np.hypot(*np.diff(tables.position_m[:, :2], axis=0).T)
    inside = np.ones(len(step), dtype=bool)
    inside[tables.first[1:] - 1] = False
    inside &= step > 0.2
    rise = np.diff(tables.position_m[:, 2])[inside] / step[inside]
    mean = 0.5 * (tables.tangent[1:, 2] + tables.tangent[:-1, 2])[inside]
    assert np.abs(rise - mean).max() < 2e-3


def test_roads_fall_in_every_town_and_not_in_junctions(networks: tuple[LaneNetwork, LaneNetwork]) -> None:
    """Away from junctions most driving lanes lean by the crossfall; inside no more than the relief does."""
    plain, rough = networks
    lean: dict[bool, list[float]] = {True: [], False: []}
    for lane in plain.lanes:
        if lane.type == "driving" and (lane.length_m > 3.0 * FADE_M or lane.junction_id is not None):
            at = np.array([lane.index]), plain.s_m([lane.index], [0.5 * lane.length_m])
            change = rough.surface.lane_bank(*at) - plain.surface.lane_bank(*at)
            lean[lane.junction_id is not None].append(abs(float(change[0])))
    assert np.max(lean[True]) < 0.01
    if max(abs(record.a) for r in plain.xodr.roads for record in r.superelevation or [_LEVEL]) == 0.0:
        assert np.median(lean[False]) == pytest.approx(FALL, abs=0.004)
