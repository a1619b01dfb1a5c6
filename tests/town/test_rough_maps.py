"""What maps bring along that nobody drew by hand: kerbs across lanes, turns in which no car turns."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from carlaloc_env.assets.catalog import EGO_REAR_M, EGO_SIZE_M
from carlaloc_env.town.config import TownConfig
from carlaloc_env.town.crossed_walks import BELOW_M, lower_walks
from carlaloc_env.town.network import LaneNetwork
from carlaloc_env.town.polygons import strip_polygon
from carlaloc_env.town.route import Route, plan_route
from carlaloc_env.town.sections import KERB_M, road_strips
from carlaloc_env.town.traffic_choice import choose_traffic

HEAD = '<OpenDRIVE><header revMajor="1" revMinor="4"/>'
LANE = '<lane id="{}" type="{}"><width sOffset="0" a="{}" b="0" c="0" d="0"/></lane>'
ROAD = (
    '<road id="{id}" length="{length}" junction="-1"><link/><planView>{plan}</planView><elevationProfile>'
    '<elevation s="0" a="{z}" b="0" c="0" d="0"/></elevationProfile><lanes><laneSection s="0"><center>'
    '<lane id="0" type="none"/></center><right>{lanes}</right></laneSection></lanes></road>'
)
LINE = '<geometry s="{}" x="{}" y="{}" hdg="{}" length="{}"><line/></geometry>'
WALKED = LANE.format(-1, "driving", 3.5) + LANE.format(-2, "sidewalk", 2.0)


def crossing(bridge_m: float) -> LaneNetwork:
    """Two roads with pavements that cross without a junction, one of them so much higher."""
    east = ROAD.format(id=1, length=80, plan=LINE.format(0, -40, 0, 0, 80), lanes=WALKED, z=0)
    north = ROAD.format(
        id=2, length=80, plan=LINE.format(0, 0, -40, math.pi / 2, 80), lanes=WALKED, z=bridge_m
    )
    return LaneNetwork.from_opendrive(f"{HEAD}{east}{north}</OpenDRIVE>".encode())


def corner(radius_m: float, width_m: float) -> LaneNetwork:
    """A lane that turns right by 90° with this radius of its middle, 40 m of straight road at both ends."""
    bend = radius_m + 0.5 * width_m
    turn = f'length="{bend * math.pi / 2}"><arc curvature="{-1 / bend}"/>'
    arc = f'<geometry s="40" x="0" y="0" hdg="0" {turn}</geometry>'
    plan = LINE.format(0, -40, 0, 0, 40) + arc
    plan += LINE.format(40 + bend * math.pi / 2, bend, -bend, -math.pi / 2, 40)
    lanes = LANE.format(-1, "driving", width_m)
    road = ROAD.format(id=1, length=80 + bend * math.pi / 2, plan=plan, lanes=lanes, z=0)
    return LaneNetwork.from_opendrive(f"{HEAD}{road}</OpenDRIVE>".encode())


def swept_off_m2(network: LaneNetwork, route: Route) -> float:
    """Area that a car sweeps beside the lane when its rear axle follows a route [m²]."""
    x = EGO_REAR_M + np.array([0.0, EGO_SIZE_M[0], EGO_SIZE_M[0], 0.0])
    y = 0.5 * EGO_SIZE_M[1] * np.array([-1.0, -1.0, 1.0, 1.0])
    c, s = np.cos(route.heading_rad)[:, None], np.sin(route.heading_rad)[:, None]
    at = route.position_m
    boxes = shapely.polygons(np.stack([at[:, :1] + c * x - s * y, at[:, 1:2] + s * x + c * y], axis=-1))
    (strip,) = road_strips(network.xodr.roads, network.surface)
    lane = shapely.buffer(strip_polygon(*strip.lane_edges(0)), 1e-3)
    return float(shapely.area(shapely.difference(shapely.union_all(boxes[8:-8]), lane)))


def sharpest_radpm(route: Route, window_m: float = 4.0) -> float:
    """Greatest curvature as a mean over a window."""
    n = round(window_m / route.step_m)
    heading = np.unwrap(route.heading_rad)
    return float(np.abs(heading[n:] - heading[:-n]).max() / (n * route.step_m))


def test_pavements_lie_low_under_lanes() -> None:
    """Both pavements are flush where the other road's lane crosses them, and whole 3 m beside it."""
    network = crossing(0.0)
    east, north = lower_walks(road_strips(network.xodr.roads, network.surface))
    assert np.interp(40.0 + 1.75, east.s_m, east.raised_m[1, 0]) == pytest.approx(-BELOW_M)
    assert np.interp(40.0 - 1.75, north.s_m, north.raised_m[1, 0]) == pytest.approx(-BELOW_M)
    for away in (-3.0, 3.5 + 3.0):
        assert np.interp(40.0 + away, east.s_m, east.raised_m[1, 0]) == pytest.approx(KERB_M)


def test_bridges_leave_pavements_alone() -> None:
    """What passes 6 m overhead lowers nothing."""
    network = crossing(6.0)
    strips = road_strips(network.xodr.roads, network.surface)
    assert all(new is old for new, old in zip(lower_walks(strips), strips, strict=True))


def test_a_car_fits_round_a_tight_corner() -> None:
    """Radius 3.4 m becomes one that a car can drive, and it sweeps less beside a lane of 4.5 m."""
    network = corner(3.4, 4.5)
    ends = [(-35.0, -2.25), (3.4, -40.0)]
    middle, fitted = (plan_route(network, ends, for_car=car) for car in (False, True))
    assert sharpest_radpm(middle) > 1 / 4.2
    assert sharpest_radpm(fitted) < 1 / 4.7
    assert fitted.fitted is not None
    assert not fitted.fitted[0]
    assert not fitted.fitted[-1]
    assert swept_off_m2(network, fitted) < 0.5 * swept_off_m2(network, middle)
    for end in (0, -1):
        np.testing.assert_allclose(fitted.position_m[end], middle.position_m[end], atol=0.3)


def test_wide_turns_stay_in_the_middle() -> None:
    """A radius of 6 m is left as it is."""
    network = corner(6.0, 3.5)
    ends = [(-35.0, -1.75), (6.0, -40.0)]
    middle, fitted = (plan_route(network, ends, for_car=car) for car in (False, True))
    assert fitted.fitted is None
    np.testing.assert_array_equal(fitted.position_m, middle.position_m)


def test_traffic_suits_the_map() -> None:
    """No walkers where there is no pavement, and few vehicles on 83 m of lane."""
    counts = choose_traffic(corner(6.0, 3.5), TownConfig()).traffic
    assert counts.walkers == 0
    assert counts.vehicles <= 1
    assert choose_traffic(crossing(0.0), TownConfig()).traffic.walkers == 6
