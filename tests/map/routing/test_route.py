"""Routes: shortest, smooth, on their lanes."""

import itertools
import math
import pathlib

import numpy as np
import pytest
from scipy.sparse import lil_array
from scipy.sparse.csgraph import dijkstra
from shared_fixtures.worlds.maps import CROSSING, MAPS, VILLAGE, carla_map
from shared_fixtures.worlds.towns import network_at

from carlaloc_env.core.errors import MapError
from carlaloc_env.core.transforms import wrap_angle
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.routing.plan_route import plan_route
from carlaloc_env.map.routing.route import Route

STRAIGHT = (
    '<OpenDRIVE><header revMajor="1" revMinor="7"/><road id="1" length="200" junction="-1"><planView>'
    '<geometry s="0" x="0" y="0" hdg="0" length="200"><arc curvature="0.004"/></geometry></planView>'
    '<elevationProfile><elevation s="0" a="0" b="0.03" c="0" d="0"/></elevationProfile><lanes>'
    '<laneSection s="0">'
    '<left>{}</left><center><lane id="0"/></center><right>{}</right></laneSection></lanes></road></OpenDRIVE>'
)


def driving(lane_id: int) -> str:
    return f'<lane id="{lane_id}" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'


@pytest.fixture(scope="module")
def crossing() -> LaneNetwork:
    return build_network(CROSSING)


def check_smooth(route: Route, *, bend_max: float = 0.5) -> None:
    """Even steps, headings along the line, no jump between neighbours."""
    p = np.concatenate([route.position_m, route.position_m[:1]]) if route.closed else route.position_m
    steps = np.hypot(*np.diff(p[:, :2], axis=0).T)
    assert steps.max() <= route.step_m * 1.001
    assert steps.min() >= route.step_m * 0.99
    chord = np.arctan2(np.diff(p[:, 1]), np.diff(p[:, 0]))
    heading = np.unwrap(route.heading_rad)
    heading = np.append(heading, heading[0]) if route.closed else heading
    middle = heading[:-1] + 0.5 * wrap_angle(np.diff(heading))
    assert np.abs(wrap_angle(chord - middle)).max() < 0.03
    assert np.abs(route.curvature_radpm).max() < bend_max


def test_turn_through_the_crossing(crossing: LaneNetwork) -> None:
    """From leg 1, left into leg 4: 20 m in, a quarter circle, 20 m out."""
    route = plan_route(crossing, [(32.0, 1.75), (-1.75, -32.0)])
    assert route.length_m == pytest.approx(20.0 + math.pi / 2 * 13.75 + 20.0, abs=1e-3)
    assert not route.closed
    check_smooth(route)
    np.testing.assert_allclose(route.at(0.0).position_m[0], [32.0, 1.75, 0.0], atol=1e-4)
    np.testing.assert_allclose(route.at(route.length_m).position_m[0], [-1.75, -32.0, 0.12], atol=0.2)
    in_turn = route.at(20.0 + 10.0)
    assert in_turn.curvature_radpm[0] == pytest.approx(1 / 13.75, rel=1e-3)
    assert np.hypot(in_turn.position_m[0, 0] - 12.0, in_turn.position_m[0, 1] + 12.0) == pytest.approx(
        13.75, abs=1e-4
    )
    roads = [crossing.lanes[n].road_id for n in route.lane]
    assert [k for k, _ in itertools.groupby(roads)] == ["1", "1014", "4"]


def test_samples_lie_on_their_lanes(crossing: LaneNetwork) -> None:
    route = plan_route(crossing, [(50.0, 1.75), (1.75, 40.0)])
    poses = crossing.pose(route.lane, route.lane_station_m)
    np.testing.assert_allclose(poses.position_m, route.position_m, atol=0.02)
    assert np.abs(np.sin(poses.heading_rad - route.heading_rad)).max() < 0.02


def test_lane_change_is_blended_and_mild() -> None:
    """Over one lane of 3.5 m: a smooth swerve of 35 m whose curvature is the quintic's."""
    network = build_network(STRAIGHT.format("", driving(-1) + driving(-2)).encode())
    first, second = network.pose([0, 1], [10.0, 170.0]).position_m[:, :2]
    route = plan_route(network, [tuple(first), tuple(second)])
    check_smooth(route)
    assert set(route.lane) == {0, 1}
    # Peak lateral curvature of 10τ³ − 15τ⁴ + 6τ⁵ is 5.77·w/L².
    swerve = np.abs(route.curvature_radpm - 0.004).max()
    assert swerve == pytest.approx(5.77 * 3.5 / 35.0**2, rel=0.05)
    assert np.allclose(np.tan(route.at(50.0).pitch_rad), 0.03, atol=2e-3)
    changing = np.hypot(
        *(network.pose(route.lane, route.lane_station_m).position_m - route.position_m)[:, :2].T
    )
    assert 30.0 < np.count_nonzero(changing > 1e-3) * route.step_m <= 36.0


FULL = '<width sOffset="0" a="3.5" b="0" c="0" d="0"/>'
TAPER = '<width sOffset="0" a="0" b="0" c="0.046666667" d="-0.002074074"/>'
BOTH = '<link><predecessor id="-1"/><successor id="-1"/></link>'


def section(s_m: float, *lanes: str) -> str:
    text = "".join(f'<lane id="-{n}" type="driving">{lane}</lane>' for n, lane in enumerate(lanes, start=1))
    return f'<laneSection s="{s_m}"><center><lane id="0"/></center><right>{text}</right></laneSection>'


POCKET = (
    '<OpenDRIVE><header revMajor="1" revMinor="7"/><road id="1" length="200" junction="-1"><planView>'
    '<geometry s="0" x="0" y="0" hdg="0" length="200"><line/></geometry></planView><lanes>'
    + section(0, '<link><successor id="-1"/></link>' + FULL)
    + section(150, BOTH + FULL, '<link><successor id="-2"/></link>' + TAPER)
    + section(
        165, BOTH.replace('<successor id="-1"/>', "") + FULL, '<link><predecessor id="-2"/></link>' + FULL
    )
    + "</lanes></road></OpenDRIVE>"
)


def test_change_into_a_short_pocket_starts_in_its_taper() -> None:
    """The pocket is reached 15 m behind its start; the swerve uses the taper of 15 m too."""
    network = build_network(POCKET.encode())
    route = plan_route(network, [(100.0, -1.75), (180.0, -5.25)])
    check_smooth(route, bend_max=0.03)
    np.testing.assert_allclose(route.position_m[-1], [180.0, -5.25, 0.0], atol=1e-3)
    y = route.position_m[:, 1]
    assert np.all(np.diff(y) < 1e-6)
    # Nothing moves before the taper begins.
    assert np.abs(y[route.position_m[:, 0] < 149.9] + 1.75).max() < 1e-6


def test_change_needs_room() -> None:
    """10 m do not hold two changes; the error says between which points."""
    network = build_network(STRAIGHT.format("", driving(-1) + driving(-2) + driving(-3)).encode())
    points = network.pose([0, 2], [10.0, 20.0]).position_m[:, :2]
    with pytest.raises(MapError, match="point 1 to point 2"):
        plan_route(network, [tuple(p) for p in points])


def test_route_does_not_run_against_traffic() -> None:
    network = build_network(STRAIGHT.format(driving(1), driving(-1)).encode())
    out = next(lane.index for lane in network.lanes if lane.lane_id == -1)
    points = network.pose([out, out], [100.0, 50.0]).position_m[:, :2]
    with pytest.raises(MapError, match="no way leads"):
        plan_route(network, [tuple(p) for p in points])


@pytest.mark.parametrize(
    ("points", "match"),
    [
        ([(0.0, 0.0)], "two points"),
        ([(50.0, 1.75), (500.0, 0.0)], "point 2 .* off every lane"),
        ([(50.0, 1.75), (math.nan, 0.0)], "not finite"),
    ],
)
def test_unusable_points(crossing: LaneNetwork, points: list[tuple[float, float]], match: str) -> None:
    with pytest.raises(MapError, match=match):
        plan_route(crossing, points)


def test_open_route_is_cut_at_its_start(crossing: LaneNetwork) -> None:
    whole = plan_route(crossing, [(60.0, 8.0), (-50.0, 2.0)])
    cut = plan_route(crossing, [(60.0, 8.0), (-50.0, 2.0)], length_m=60.0)
    assert cut.length_m == pytest.approx(60.0, abs=0.5)
    np.testing.assert_allclose(cut.position_m[-1], whole.position_m[-1])
    with pytest.raises(MapError, match="900 m are asked"):
        plan_route(crossing, [(60.0, 8.0), (-50.0, 2.0)], length_m=900.0)


@pytest.mark.long
@pytest.mark.parametrize("path", MAPS)
def test_loops_on_real_maps(path: pathlib.Path) -> None:
    """Loops through drawn points: closed, smooth, projected back to where they were asked."""
    network = network_at(path)
    rng = np.random.default_rng(11)
    free = [
        n.index for n in network.lanes if n.type == "driving" and n.junction_id is None and n.length_m > 20.0
    ]
    for _ in range(3):
        lanes = rng.choice(free, 3, replace=False)
        points = network.pose(lanes, 0.5 * network.tables.length_m[lanes]).position_m[:, :2]
        route = plan_route(network, [tuple(p) for p in points], loop=True)
        assert route.closed
        check_smooth(route, bend_max=1.2)
        np.testing.assert_allclose(route.at(route.length_m).position_m, route.at(0.0).position_m, atol=1e-9)
        for s in rng.uniform(0.0, route.length_m, 20):
            pose = route.at(s)
            c, w = math.cos(pose.heading_rad[0]), math.sin(pose.heading_rad[0])
            beside = pose.position_m[0, :2] + 0.4 * np.array([-w, c])
            back, offset = route.project(beside, near_s_m=s + 3.0)
            assert abs(wrap_angle((back - s) / route.length_m * 2 * np.pi)) * route.length_m / 2 / np.pi < 0.1
            assert offset == pytest.approx(0.4, abs=0.01)
        turned = route.starting_at(points[1])
        assert np.hypot(*(turned.position_m[0, :2] - points[1])) < 0.6


@pytest.mark.parametrize("path", [VILLAGE, carla_map("Town07")])
def test_path_is_the_shortest(path: pathlib.Path) -> None:
    """Lengths of routes against scipy's Dijkstra on the same lanes, where no lane changes exist."""
    network = network_at(path)
    graph = lil_array((len(network.lanes), len(network.lanes)))
    for lane in network.lanes:
        for n in lane.successors:
            if lane.type == "driving" and network.lanes[n].type == "driving":
                graph[lane.index, n] = lane.length_m
    rng = np.random.default_rng(2)
    free = [
        n.index for n in network.lanes if n.type == "driving" and n.junction_id is None and n.length_m > 20.0
    ]
    for _ in range(10):
        a, b = (int(n) for n in rng.choice(free, 2, replace=False))
        middle = 0.5 * network.tables.length_m[[a, b]]
        points = network.pose([a, b], middle).position_m[:, :2]
        route = plan_route(network, [tuple(p) for p in points])
        shortest = dijkstra(graph.tocsr(), indices=a)[b] - middle[0] + middle[1]
        assert route.length_m == pytest.approx(shortest, rel=2e-3, abs=0.2)
