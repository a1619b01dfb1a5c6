"""Roads as curves and surfaces against closed forms."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.special import fresnel

from carlaloc_env.town.lanes.build_network import build_network
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.town.opendrive.reader import read_opendrive
from carlaloc_env.town.opendrive.records import OpenDrive
from carlaloc_env.town.opendrive.reference_line import LinePose
from carlaloc_env.town.opendrive.road_surface import RoadSurface

X0, Y0, H0 = 3.0, -7.0, 0.6
WIDTH = '<width sOffset="0" a="3" b="0" c="0" d="0"/>'
LANES = (
    f'<laneSection s="0"><left><lane id="1" type="driving">{WIDTH}</lane></left>'
    '<center><lane id="0" type="none"/></center>'
    f'<right><lane id="-1" type="driving">{WIDTH}</lane></right></laneSection>'
)
FLAT = '<elevation s="0" a="0" b="0" c="0" d="0"/>'


def road(
    shape: str,
    length: float,
    *,
    lanes: str = LANES,
    offset: str = "",
    elevation: str = FLAT,
    lateral: str = "",
    head: str = "",
    attributes: str = "",
) -> OpenDrive:
    return read_opendrive(
        '<OpenDRIVE><header revMajor="1" revMinor="7"/>'
        f'<road id="1" length="{length!r}" junction="-1" {attributes}>{head}<planView>'
        f'<geometry s="0" x="{X0}" y="{Y0}" hdg="{H0}" length="{length!r}">{shape}</geometry></planView>'
        f"<elevationProfile>{elevation}</elevationProfile><lateralProfile>{lateral}</lateralProfile>"
        f"<lanes>{offset}{lanes}</lanes></road></OpenDRIVE>".encode()
    )


def line_at(xodr: OpenDrive, s: NDArray[np.float64]) -> LinePose:
    return RoadSurface(xodr.roads).plan_view.evaluate(np.zeros(len(s), dtype=np.int64), s)


def to_world(
    u: NDArray[np.float64], v: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return X0 + math.cos(H0) * u - math.sin(H0) * v, Y0 + math.sin(H0) * u + math.cos(H0) * v


@pytest.mark.parametrize("curvature", [0.25, -0.05, 1e-3, 1e-9, 1e-15, 0.0])
def test_arc_is_a_circle(curvature: float) -> None:
    length = 60.0
    s = np.linspace(0.0, length, 121)
    line = line_at(road(f'<arc curvature="{curvature!r}"/>', length), s)
    if abs(curvature) > 1e-6:
        u, v = np.sin(curvature * s) / curvature, (1.0 - np.cos(curvature * s)) / curvature
    else:
        # Two terms of the series are exact to rounding here.
        u, v = s, 0.5 * curvature * s * s
    x, y = to_world(u, v)
    np.testing.assert_allclose(line.x_m, x, atol=1e-9)
    np.testing.assert_allclose(line.y_m, y, atol=1e-9)
    np.testing.assert_allclose(line.heading_rad, H0 + curvature * s, atol=1e-12)


@pytest.mark.parametrize(
    ("k0", "k1", "length"),
    [(0.0, 0.1, 40.0), (0.1, 0.0, 40.0), (-0.02, 0.05, 80.0), (0.3, 0.29, 50.0), (0.0, -0.5, 60.0)],
)
def test_spiral_is_fresnels(k0: float, k1: float, length: float) -> None:
    """∫(cos θ, sin θ) by scipy's Fresnel integrals, for a curvature that crosses zero too."""
    s = np.linspace(0.0, length, 97)
    line = line_at(road(f'<spiral curvStart="{k0}" curvEnd="{k1}"/>', length), s)
    c = (k1 - k0) / length
    a, s0 = math.sqrt(math.pi / abs(c)), k0 / c
    S1, C1 = fresnel((s0 + s) / a)
    S0, C0 = fresnel(s0 / a)
    plane = a * ((C1 - C0) + 1j * math.copysign(1.0, c) * (S1 - S0)) * np.exp(-0.5j * c * s0 * s0)
    x, y = to_world(plane.real, plane.imag)
    np.testing.assert_allclose(line.x_m, x, atol=1e-9)
    np.testing.assert_allclose(line.y_m, y, atol=1e-9)
    np.testing.assert_allclose(line.heading_rad, H0 + k0 * s + 0.5 * c * s * s, atol=1e-12)
    np.testing.assert_allclose(line.curvature_radpm, k0 + c * s, atol=1e-12)


def test_spiral_of_equal_curvatures_is_an_arc() -> None:
    s = np.linspace(0.0, 30.0, 31)
    spiral = line_at(road('<spiral curvStart="0.05" curvEnd="0.05"/>', 30.0), s)
    arc = line_at(road('<arc curvature="0.05"/>', 30.0), s)
    np.testing.assert_allclose(np.stack(spiral), np.stack(arc), atol=1e-12)


def test_poly3_runs_by_arc_length() -> None:
    """The point at s is the one whose arc length from the start, by scipy, is s."""
    b, c, d = 0.1, 0.01, -2e-4
    line = line_at(road(f'<poly3 a="0" b="{b}" c="{c}" d="{d}"/>', 35.0), np.linspace(0.0, 35.0, 15))
    dx, dy = line.x_m - X0, line.y_m - Y0
    u, v = math.cos(H0) * dx + math.sin(H0) * dy, math.cos(H0) * dy - math.sin(H0) * dx
    np.testing.assert_allclose(v, b * u + c * u**2 + d * u**3, atol=1e-9)
    for n, end in enumerate(u):
        arc = quad(lambda p: math.hypot(1.0, b + 2 * c * p + 3 * d * p * p), 0.0, end, epsabs=1e-12)[0]
        assert arc == pytest.approx(35.0 / 14.0 * n, abs=1e-7)
    slope = b + 2 * c * u + 3 * d * u**2
    np.testing.assert_allclose(line.heading_rad, H0 + np.arctan(slope), atol=1e-9)
    np.testing.assert_allclose(line.curvature_radpm, (2 * c + 6 * d * u) / (1 + slope**2) ** 1.5, atol=1e-9)


@pytest.mark.parametrize("span", ["normalized", "arcLength"])
def test_param_poly3_is_scaled_to_its_length(span: str) -> None:
    """s runs evenly along the curve: equal steps of s are equal arcs."""
    length = 25.0
    p_max = 1.0 if span == "normalized" else length
    U = (0.0, 20.0 / p_max, 3.0 / p_max**2, -2.0 / p_max**3)
    V = (0.0, 0.0, 9.0 / p_max**2, -4.0 / p_max**3)
    names = zip(("aU", "bU", "cU", "dU", "aV", "bV", "cV", "dV"), U + V, strict=True)
    text = " ".join(f'{name}="{value!r}"' for name, value in names)
    s = np.linspace(0.0, length, 2001)
    line = line_at(road(f'<paramPoly3 pRange="{span}" {text}/>', length), s)

    def at(c: tuple[float, ...], p: float) -> float:
        return c[0] + p * (c[1] + p * (c[2] + p * c[3]))

    x, y = to_world(np.array([at(U, p_max)]), np.array([at(V, p_max)]))
    np.testing.assert_allclose([line.x_m[-1], line.y_m[-1]], [x[0], y[0]], atol=1e-8)
    steps = np.hypot(np.diff(line.x_m), np.diff(line.y_m))
    assert steps.max() / steps.min() - 1.0 < 1e-6
    chord = np.arctan2(np.diff(line.y_m), np.diff(line.x_m))
    np.testing.assert_allclose(chord, 0.5 * (line.heading_rad[1:] + line.heading_rad[:-1]), atol=1e-6)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    np.testing.assert_allclose(line.rate, arc[-1] / length, rtol=1e-5)
    bend = np.gradient(line.heading_rad, arc)[5:-5]
    np.testing.assert_allclose(line.curvature_radpm[5:-5], bend, atol=2e-5)
    change = np.gradient(line.curvature_radpm, arc)[5:-5]
    np.testing.assert_allclose(line.curvature_slope[5:-5], change, atol=2e-5)


def lane_points(network: LaneNetwork, lane_id: int, s: NDArray[np.float64]) -> NDArray[np.float64]:
    lane = next(n.index for n in network.lanes if n.lane_id == lane_id)
    return network.surface.lane_centre(np.full(len(s), lane), s).position_m


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
        "<left>",
        '<left><lane id="2" type="driving"><width sOffset="0" a="3" b="0" c="0" d="0"/></lane>',
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


def test_geo_reference_gives_the_origin() -> None:
    head = (
        b'<OpenDRIVE><header revMajor="1" revMinor="6"><geoReference>'
        b"<![CDATA[+proj=tmerc +lat_0=48.5 +lon_0=9.25]]>"
        b'</geoReference></header><road id="1" length="9" junction="-1"><planView>'
        b'<geometry s="0" x="0" y="0" hdg="0" length="9"><line/></geometry></planView><lanes>'
        + LANES.encode()
        + b"</lanes></road></OpenDRIVE>"
    )
    origin = read_opendrive(head).geodetic_origin()
    assert origin is not None
    assert (origin.latitude_deg, origin.longitude_deg) == (48.5, 9.25)


def test_lanes_beside_a_stretched_curve_keep_their_true_length() -> None:
    """A quarter-like curve stated 20 % too long: lane lengths are those of their points."""
    shape = '<paramPoly3 pRange="normalized" aU="0" bU="20" cU="3" dU="-2" aV="0" bV="0" cV="9" dV="-4"/>'
    network = build_network(road(shape, 26.0))
    for lane in network.lanes:
        points = network.pose(np.full(4001, lane.index), np.linspace(0.0, lane.length_m, 4001)).position_m
        assert np.hypot(*np.diff(points[:, :2], axis=0).T).sum() == pytest.approx(lane.length_m, rel=1e-4)
