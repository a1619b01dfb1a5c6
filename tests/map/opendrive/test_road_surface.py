"""Lanes, heights and limits of a road against closed forms."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from shared_fixtures.worlds.single_roads import H0, LANES, lane_points, road, to_world

from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.opendrive.road_surface import RoadSurface


def test_superelevation_lifts_the_left_side() -> None:
    """A bank of 0.1 rad turns the whole cross-section about the reference line."""
    bank = '<superelevation s="0" a="0.1" b="0" c="0" d="0"/>'
    network = build_network(road("<line/>", 50.0, lateral=bank))
    s = np.linspace(0.0, 50.0, 11)
    x, y = to_world(s, np.full(11, 1.5 * math.cos(0.1)))
    left = lane_points(network, 1, s)
    np.testing.assert_allclose(left, np.stack([x, y, np.full(11, 1.5 * math.sin(0.1))], axis=-1), atol=1e-12)
    assert lane_points(network, -1, s)[0, 2] == pytest.approx(-1.5 * math.sin(0.1))


def test_lateral_shape_is_blended_between_profiles() -> None:
    """Crown of 2 % on the left half; it fades in linearly over 20 m."""
    shape = '<shape s="0" t="-10" a="0" b="0" c="0" d="0"/><shape s="20" t="-10" a="0" b="0" c="0" d="0"/>'
    shape += '<shape s="20" t="0" a="0" b="-0.02" c="0" d="0"/>'
    surface = RoadSurface(road("<line/>", 50.0, lateral=shape).roads)
    s = np.array([0.0, 10.0, 20.0, 40.0])
    z = surface.position(np.zeros(4, dtype=np.int64), s, np.full(4, 2.0))[:, 2]
    np.testing.assert_allclose(z, [0.0, -0.02, -0.04, -0.04], atol=1e-12)
    right = surface.position(np.zeros(4, dtype=np.int64), s, np.full(4, -2.0))[:, 2]
    np.testing.assert_allclose(right, 0.0, atol=1e-12)


def test_elevation_gives_height_and_pitch() -> None:
    """z = 1 + 0.05 s + 0.001 s²; nose up with rising road, down for the oncoming lane."""
    network = build_network(
        road("<line/>", 40.0, elevation='<elevation s="0" a="1" b="0.05" c="0.001" d="0"/>')
    )
    by_id = {lane.lane_id: lane.index for lane in network.lanes}
    there = network.exact_pose([by_id[-1]], [30.0])
    back = network.exact_pose([by_id[1]], [10.0])
    assert there.position_m[0, 2] == pytest.approx(1.0 + 1.5 + 0.9)
    assert math.tan(there.pitch_rad[0]) == pytest.approx(0.05 + 0.06)
    assert back.position_m[0, 2] == pytest.approx(there.position_m[0, 2])
    assert back.pitch_rad[0] == pytest.approx(-there.pitch_rad[0])


def test_lane_on_an_arc_is_a_concentric_circle() -> None:
    """Length, curvature and heading of lanes at ±1.5 m of an arc of radius 20 m."""
    network = build_network(road('<arc curvature="0.05"/>', 30.0))
    for lane in network.lanes:
        radius = 20.0 - math.copysign(1.5, lane.lane_id)
        assert lane.length_m == pytest.approx(30.0 * radius / 20.0, rel=1e-9)
        pose = network.pose([lane.index], [0.3 * lane.length_m])
        assert pose.curvature_radpm[0] == pytest.approx(math.copysign(1.0 / radius, -lane.lane_id), rel=1e-9)


def test_heading_of_a_widening_lane_is_its_tangent() -> None:
    """The lane's heading is the direction of its own points, not of the road."""
    lanes = LANES.replace(
        '<lane id="-1" type="driving"><width sOffset="0" a="3" b="0" c="0" d="0"/>',
        '<lane id="-1" type="driving"><width sOffset="0" a="3" b="0.2" c="0.01" d="-0.0001"/>',
    )
    offset = '<laneOffset s="0" a="0" b="0.1" c="0" d="0"/>'
    network = build_network(road('<arc curvature="-0.03"/>', 30.0, lanes=lanes, offset=offset))
    lane = next(n.index for n in network.lanes if n.lane_id == -1)
    s = np.linspace(1.0, 29.0, 57)
    step = 1e-5
    before, after = lane_points(network, -1, s - step), lane_points(network, -1, s + step)
    tangent = np.arctan2(after[:, 1] - before[:, 1], after[:, 0] - before[:, 0])
    curve = network.surface.lane_centre(np.full(57, lane), s)
    np.testing.assert_allclose(np.sin(curve.heading_rad - tangent), 0.0, atol=1e-8)
    arc = np.hypot(*(after - before)[:, :2].T) / (2.0 * step)
    np.testing.assert_allclose(curve.stretch, arc, rtol=1e-7)
    fine = network.surface.lane_centre(np.full(2, lane), np.array([14.999, 15.001]))
    turned = (fine.heading_rad[1] - fine.heading_rad[0]) / (0.002 * curve.stretch[28])
    assert curve.curvature_radpm[28] == pytest.approx(turned, abs=1e-6)


def test_left_hand_traffic_turns_the_lanes_round() -> None:
    """With rule LHT the lane left of the line runs with s, and passing lanes lie to its right."""
    second = LANES.replace(
        "<left>", '<left><lane id="2" type="driving"><width sOffset="0" a="3" b="0" c="0" d="0"/></lane>'
    )
    for rule, lane_id, heading in (("RHT", -1, H0), ("LHT", 1, H0), ("LHT", -1, H0 + math.pi)):
        network = build_network(road("<line/>", 20.0, lanes=second, attributes=f'rule="{rule}"'))
        by_id = {lane.lane_id: lane for lane in network.lanes}
        pose = network.pose([by_id[lane_id].index], [5.0])
        assert math.cos(pose.heading_rad[0] - heading) == pytest.approx(1.0)
        if rule == "LHT":
            assert by_id[1].right is None or by_id[1].right != by_id[2].index
            assert by_id[1].left == by_id[2].index
        else:
            assert by_id[1].right == by_id[2].index


@pytest.mark.parametrize(
    ("text", "limit_mps"),
    [
        ('max="50" unit="km/h"', 50.0 / 3.6),
        ('max="25" unit="mph"', 11.176),
        ('max="9" unit="m/s"', 9.0),
        ('max="9"', 9.0),
        ('max="no limit"', math.inf),
        ('max="undefined"', math.inf),
    ],
)
def test_speed_units(text: str, limit_mps: float) -> None:
    xodr = road("<line/>", 20.0, head=f'<type s="0" type="town"><speed {text}/></type>')
    assert xodr.roads[0].speeds[0].limit_mps == pytest.approx(limit_mps)


def test_lane_speed_overrides_the_road() -> None:
    lanes = LANES.replace(
        '<lane id="-1" type="driving">',
        '<lane id="-1" type="driving"><speed sOffset="0" max="10"/><speed sOffset="12" max="36" unit="km/h"/>'
        '<speed sOffset="20" max="5"/>',
    )
    head = '<type s="0" type="town"><speed max="20"/></type>'
    head += '<type s="15" type="town"><speed max="15"/></type>'
    network = build_network(road("<line/>", 40.0, lanes=lanes, head=head))
    by_id = {lane.lane_id: lane.index for lane in network.lanes}
    np.testing.assert_allclose(network.speed_limit_mps([by_id[-1]] * 3, [1.0, 13.0, 30.0]), [10.0, 10.0, 5.0])
    np.testing.assert_allclose(network.speed_limit_mps([by_id[1]] * 2, [1.0, 39.0]), [15.0, 20.0])


def test_borders_replace_widths() -> None:
    """A border says where the outer edge lies; the next lane's width counts from there."""
    lanes = (
        '<laneSection s="0"><center><lane id="0" type="none"/></center><right>'
        '<lane id="-1" type="driving"><border sOffset="0" a="-3" b="-0.1" c="0" d="0"/></lane>'
        '<lane id="-2" type="driving"><width sOffset="0" a="2" b="0" c="0" d="0"/></lane></right>'
        "</laneSection>"
    )
    network = build_network(road("<line/>", 20.0, lanes=lanes))
    edges = network.surface.edges
    s = np.array([10.0, 10.0])
    np.testing.assert_allclose(edges.outer(np.array([0, 1]), s).t_m, [-4.0, -6.0])
    np.testing.assert_allclose(edges.width(np.array([0, 1]), s), [4.0, 2.0])
    np.testing.assert_allclose(edges.centre(np.array([0, 1]), s).t_m, [-2.0, -5.0])


def test_lane_heights_are_linear_across() -> None:
    lanes = LANES.replace(
        '<lane id="-1" type="driving">',
        '<lane id="-1" type="sidewalk"><height sOffset="0" inner="0.1" outer="0.2"/>',
    )
    network = build_network(road("<line/>", 20.0, lanes=lanes))
    assert lane_points(network, -1, np.array([5.0]))[0, 2] == pytest.approx(0.15)


def test_records_take_effect_at_their_s() -> None:
    """Piecewise records: at a record's own s it is the later one that holds."""
    elevation = '<elevation s="0" a="0" b="0" c="0" d="0"/><elevation s="10" a="1" b="0.5" c="0" d="0"/>'
    surface = RoadSurface(road("<line/>", 20.0, elevation=elevation).roads)
    at: Callable[[float], float] = lambda s: float(  # noqa: E731
        surface.position(np.array([0]), np.array([s]), np.array([0.0]))[0, 2]
    )
    assert at(9.999999) == 0.0
    assert at(10.0) == 1.0
    assert at(12.0) == 2.0


def test_lanes_beside_a_stretched_curve_keep_their_true_length() -> None:
    """A quarter-like curve stated 20 % too long: lane lengths are those of their points."""
    shape = '<paramPoly3 pRange="normalized" aU="0" bU="20" cU="3" dU="-2" aV="0" bV="0" cV="9" dV="-4"/>'
    network = build_network(road(shape, 26.0))
    for lane in network.lanes:
        points = network.pose(np.full(4001, lane.index), np.linspace(0.0, lane.length_m, 4001)).position_m
        assert np.hypot(*np.diff(points[:, :2], axis=0).T).sum() == pytest.approx(lane.length_m, rel=1e-4)
