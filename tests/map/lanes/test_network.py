"""The lane network of a small crossing whose answers are known on paper."""

import cProfile
import math
import pstats

import numpy as np
import pytest
from shared_fixtures.worlds.maps import CROSSING

from carlaloc_env.core.errors import MapError
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.lanes.lanes import Lane

# Legs 1 to 4 leave the crossing eastwards, northwards, westwards and southwards.
OUTWARD = {"1": 0.0, "2": math.pi / 2, "3": math.pi, "4": -math.pi / 2}


@pytest.fixture(scope="module")
def network() -> LaneNetwork:
    return build_network(CROSSING)


def lane(network: LaneNetwork, road: str, lane_id: int, section: int = 0) -> Lane:
    return next(n for n in network.lanes if (n.road_id, n.lane_id, n.section) == (road, lane_id, section))


def test_every_leg_leads_to_the_three_others(network: LaneNetwork) -> None:
    for leg in OUTWARD:
        inward = lane(network, leg, 1)
        assert {network.lanes[n].road_id for n in inward.successors} == {
            f"10{leg}{other}" for other in OUTWARD if other != leg
        }
        for n in inward.successors:
            (target,) = network.lanes[n].successors
            assert network.lanes[target].lane_id == -1
            assert network.lanes[n].predecessors == (inward.index,)
            assert inward.index in network.lanes[n].predecessors


def test_sections_follow_each_other(network: LaneNetwork) -> None:
    """Leg 4 has two sections: outward −1 → −1, inward from the second to the first."""
    assert lane(network, "4", -1, 0).successors == (lane(network, "4", -1, 1).index,)
    assert lane(network, "4", 1, 1).successors == (lane(network, "4", 1, 0).index,)


def test_neighbours_share_the_travel_direction(network: LaneNetwork) -> None:
    inner, outer = lane(network, "4", -1, 1), lane(network, "4", -2, 1)
    assert (inner.left, inner.right) == (None, outer.index)
    assert (outer.left, outer.right) == (inner.index, None)
    # Across the centre line traffic comes the other way; a sidewalk is no neighbour.
    assert (lane(network, "1", -1).left, lane(network, "1", -1).right) == (None, None)


def test_station_runs_in_travel_direction(network: LaneNetwork) -> None:
    for leg, angle in OUTWARD.items():
        out, back = lane(network, leg, -1), lane(network, leg, 1)
        assert out.forward
        assert not back.forward
        start = network.pose([out.index], [0.0])
        end = network.pose([back.index], [back.length_m])
        assert math.cos(start.heading_rad[0] - angle) == pytest.approx(1.0)
        assert math.cos(end.heading_rad[0] - angle) == pytest.approx(-1.0)
        # 12 m from the centre, half a lane to the right of the leg's own direction.
        x, y = (
            12.0 * math.cos(angle) + 1.75 * math.sin(angle),
            12.0 * math.sin(angle) - 1.75 * math.cos(angle),
        )
        np.testing.assert_allclose(start.position_m[0], [x, y, 0.0], atol=1e-9)


def test_turn_lengths(network: LaneNetwork) -> None:
    """Lane centres of the turns: straight 24 m, left on radius 12 + 1.75, right on 12 − 1.75."""
    assert lane(network, "1013", -1).length_m == pytest.approx(24.0, abs=1e-9)
    assert lane(network, "1014", -1).length_m == pytest.approx(math.pi / 2 * 13.75, abs=1e-6)
    assert lane(network, "1012", -1).length_m == pytest.approx(math.pi / 2 * 10.25, abs=1e-6)


def test_tables_follow_the_exact_lanes(network: LaneNetwork) -> None:
    """Half-metre tables stay within a millimetre of the file's own curves, sideways."""
    rng = np.random.default_rng(3)
    lanes = rng.integers(0, len(network.lanes), 2000)
    station = rng.random(2000) * network.tables.length_m[lanes]
    table, exact = network.pose(lanes, station), network.exact_pose(lanes, station)
    delta = table.position_m - exact.position_m
    across = delta[:, 1] * np.cos(exact.heading_rad) - delta[:, 0] * np.sin(exact.heading_rad)
    assert np.abs(across).max() < 1e-3
    assert np.abs(delta[:, 2]).max() < 1e-3
    assert np.hypot(delta[:, 0], delta[:, 1]).max() < 0.01
    assert np.abs(np.sin(table.heading_rad - exact.heading_rad)).max() < 2e-3
    np.testing.assert_allclose(network.station_m(lanes, network.s_m(lanes, station)), station, atol=1e-9)


def test_length_is_the_sum_of_small_chords(network: LaneNetwork) -> None:
    for record in network.lanes:
        count = max(4, int(record.length_m * 50))
        points = network.pose(
            np.full(count, record.index), np.linspace(0.0, record.length_m, count)
        ).position_m
        chords = np.hypot(*np.diff(points[:, :2], axis=0).T).sum()
        assert chords == pytest.approx(record.length_m, rel=2e-4)


def test_width_and_speed(network: LaneNetwork) -> None:
    """Leg 3 widens outwards; leg 2 is limited to 25 mph for 10 m, then to 10 m/s."""
    wide = lane(network, "3", -1)
    road = network.xodr.roads[network.road_index["3"]]
    ds = road.length_m - 30.0
    end = 3.5 + 0.003 * ds**2 - 0.0001 * ds**3
    widths = network.width_m([wide.index] * 2, [0.0, wide.length_m])
    np.testing.assert_allclose(widths, [3.5, end], atol=1e-9)
    slow = lane(network, "2", -1)
    limits = network.speed_limit_mps([slow.index] * 2, [5.0, 30.0])
    np.testing.assert_allclose(limits, [25 * 0.44704, 10.0])
    assert lane(network, "1", 1).speed_limit_mps == pytest.approx(50 / 3.6)
    # Turns state no limit and take over the one of the lane that leads to them.
    assert lane(network, "1013", -1).speed_limit_mps == pytest.approx(50 / 3.6)


def test_nearest_agrees_with_a_search_over_all_points(network: LaneNetwork) -> None:
    """The k-d tree's answer is as near as the nearest of densely sampled lane points."""
    rng = np.random.default_rng(5)
    driving = [n for n in network.lanes if n.type == "driving"]
    dense = np.concatenate(
        [
            network.pose(np.full(1500, n.index), np.linspace(0.0, n.length_m, 1500)).position_m[:, :2]
            for n in driving
        ]
    )
    points = rng.uniform(-60.0, 60.0, (100, 2))
    found = network.nearest(points)
    direct = np.sqrt(((points[:, None] - dense[None]) ** 2).sum(axis=2).min(axis=1))
    np.testing.assert_allclose(found.distance_m, direct, atol=2e-3)
    poses = network.pose(found.lane, found.station_m)
    inside = (found.station_m > 0.01) & (found.station_m < network.tables.length_m[found.lane] - 0.01)
    left = np.stack([-np.sin(poses.heading_rad), np.cos(poses.heading_rad)], axis=-1)
    foot = poses.position_m[:, :2] + found.offset_m[:, None] * left
    np.testing.assert_allclose(foot[inside], points[inside], atol=0.02)


def test_nearest_in_space_tells_levels_apart(network: LaneNetwork) -> None:
    sidewalk = lane(network, "1", -2)
    point = network.pose([sidewalk.index], [20.0]).position_m
    assert network.nearest(point, types=("sidewalk",)).lane[0] == sidewalk.index
    assert network.nearest(point + np.array([0.0, 0.0, 30.0])).distance_m[0] > 25.0
    with pytest.raises(MapError, match="tram"):
        network.nearest(point, types=("tram",))


def test_lights_hold_the_lanes_before_them(network: LaneNetwork) -> None:
    """Light 101 acts by references on the turns, the others by validity on the approach."""
    heads = {head.id: head for head in network.signals}
    assert list(heads) == ["101", "102", "103", "104"]
    for leg in OUTWARD:
        head, inward = heads[f"10{leg}"], lane(network, leg, 1)
        assert head.lanes == (inward.index,)
        assert sorted(head.junction_lanes) == sorted(inward.successors)
        assert head.junction_id == "100"
        assert head.controller_id == ("201" if leg in "13" else "202")
        before = 0.0 if leg == "1" else 6.0
        assert head.stop_station_m[0] == pytest.approx(inward.length_m - before, abs=1e-6)
        # It looks outwards along its leg, at the drivers who come in.
        face = head.T_world_signal[:3, 0]
        assert face[0] * math.cos(OUTWARD[leg]) + face[1] * math.sin(OUTWARD[leg]) == pytest.approx(1.0)
        assert np.linalg.det(head.T_world_signal[:3, :3]) == pytest.approx(1.0)


def test_signs(network: LaneNetwork) -> None:
    signs = {sign.id: sign for sign in network.static_signs}
    stop = signs["110"]
    assert (stop.kind, stop.lanes) == ("stop", (lane(network, "2", -1).index,))
    assert signs["39"].kind == "speed"
    assert signs["39"].speed_mps == pytest.approx(30 * 0.44704)


def test_crosswalks_lead_across(network: LaneNetwork) -> None:
    """3 m wide, 7 m across, 15 m from the centre, square to each leg, over both lanes."""
    assert len(network.crosswalks) == 4
    for crosswalk, (leg, angle) in zip(network.crosswalks, OUTWARD.items(), strict=True):
        assert crosswalk.width_m == pytest.approx(3.0)
        middle = 0.5 * (crosswalk.start_m + crosswalk.end_m)
        np.testing.assert_allclose(middle, [15 * math.cos(angle), 15 * math.sin(angle), 0.0], atol=1e-6)
        way = crosswalk.end_m - crosswalk.start_m
        assert np.hypot(*way[:2]) == pytest.approx(7.0)
        assert abs(way[0] * math.cos(angle) + way[1] * math.sin(angle)) < 1e-6
        assert len(crosswalk.polygon_m) == 4
        assert set(crosswalk.lanes) == {lane(network, leg, 1).index, lane(network, leg, -1).index}


def test_poses_are_not_looked_up_one_by_one(network: LaneNetwork) -> None:
    """Three hundred take as many calls of Python as three."""
    rng = np.random.default_rng(0)
    lanes = rng.integers(0, len(network.lanes), 300)
    station = rng.random(300) * network.tables.length_m[lanes]

    def calls(count: int) -> int:
        profile = cProfile.Profile()
        profile.runcall(network.pose, lanes[:count], station[:count])
        return int(pstats.Stats(profile).total_calls)  # type: ignore[attr-defined]

    calls(3)
    assert calls(300) == calls(3) < 100
