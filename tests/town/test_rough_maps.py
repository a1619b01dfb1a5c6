"""What maps bring along that nobody drew by hand: kerbs across lanes, turns in which no car turns."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from carlaloc_env.core.areas import strip_polygon
from carlaloc_env.core.ego import EGO_REAR_M, EGO_SIZE_M
from carlaloc_env.map.config import TrafficCounts
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.routing.driving_line import inside_line
from carlaloc_env.map.routing.plan_route import plan_route
from carlaloc_env.map.routing.route import Route
from carlaloc_env.map.routing.smoothing import RouteLine
from carlaloc_env.map.traffic_counts import traffic_counts
from carlaloc_env.physics.params import VehicleParams
from carlaloc_env.scenery.ground.lane_strips import KERB_M, road_strips
from carlaloc_env.scenery.ground.lowered_walks import BELOW_M, lower_walks
from carlaloc_env.scenery.kerbs.swept_path import raised_near
from carlaloc_env.scenery.kerbs.tight_turns import fit_turns

HEAD = '<OpenDRIVE><header revMajor="1" revMinor="4"/>'
LANE = '<lane id="{}" type="{}"><width sOffset="0" a="{}" b="0" c="0" d="0"/></lane>'
ROAD = (
    '<road id="{id}" length="{length}" junction="-1"><link/><planView>{plan}</planView><elevationProfile>'
    '<elevation s="0" a="{z}" b="0" c="0" d="0"/></elevationProfile><lanes><laneSection s="0"><center>'
    '<lane id="0" type="none"/></center><right>{lanes}</right></laneSection></lanes></road>'
)
LINE = '<geometry s="{}" x="{}" y="{}" hdg="{}" length="{}"><line/></geometry>'
WALKED = LANE.format(-1, "driving", 3.5) + LANE.format(-2, "sidewalk", 2.0)

WHEELBASE_M, TRACK_M = VehicleParams().wheelbase_m, VehicleParams().track_m


def crossing(bridge_m: float) -> LaneNetwork:
    """Two roads with sidewalks that cross without a junction, one of them so much higher."""
    east = ROAD.format(id=1, length=80, plan=LINE.format(0, -40, 0, 0, 80), lanes=WALKED, z=0)
    north = ROAD.format(
        id=2, length=80, plan=LINE.format(0, 0, -40, math.pi / 2, 80), lanes=WALKED, z=bridge_m
    )
    return build_network(f"{HEAD}{east}{north}</OpenDRIVE>".encode())


def corner(radius_m: float, width_m: float, *, walks: bool = False) -> LaneNetwork:
    """A lane that turns right by 90° with this radius of its middle, 40 m of straight road at both ends.

    With sidewalks on both sides on request.
    """
    bend = radius_m + 0.5 * width_m
    turn = f'length="{bend * math.pi / 2}"><arc curvature="{-1 / bend}"/>'
    arc = f'<geometry s="40" x="0" y="0" hdg="0" {turn}</geometry>'
    plan = LINE.format(0, -40, 0, 0, 40) + arc
    plan += LINE.format(40 + bend * math.pi / 2, bend, -bend, -math.pi / 2, 40)
    lanes = LANE.format(-1, "driving", width_m) + (LANE.format(-2, "sidewalk", 1.0) if walks else "")
    road = ROAD.format(id=1, length=80 + bend * math.pi / 2, plan=plan, lanes=lanes, z=0)
    if walks:
        left = f"</center><left>{LANE.format(1, 'sidewalk', 2.0)}</left>"
        road = road.replace("<left/>", "").replace("</center>", left)
        # The standard wants left lanes first.
        section = road[road.index("<center>") : road.index("</left>") + len("</left>")]
        centre, outer = section.split("</center>")
        road = road.replace(section, f"{outer}{centre}</center>")
    return build_network(f"{HEAD}{road}</OpenDRIVE>".encode())


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


def on_kerbs_m2(network: LaneNetwork, route: Route) -> float:
    """Area of raised sidewalks that the tyres run over when the rear axle follows a route [m²]."""
    outer, inner = 0.5 * TRACK_M + 0.1, 0.5 * TRACK_M - 0.1
    c, s = np.cos(route.heading_rad)[:, None], np.sin(route.heading_rad)[:, None]
    prints = []
    for axle, side in itertools.product((0.0, WHEELBASE_M), (1.0, -1.0)):
        x = axle + np.array([-0.15, 0.15, 0.15, -0.15])
        y = side * np.array([inner, inner, outer, outer])
        corners = np.stack([c * x - s * y, s * x + c * y], axis=-1)
        prints.append(shapely.polygons(route.position_m[:, None, :2] + corners))
    tracks = shapely.union_all([shapely.union_all(part[8:-8]) for part in prints])
    (strip,) = road_strips(network.xodr.roads, network.surface)
    walks = [strip_polygon(*strip.lane_edges(k)) for k in range(3) if strip.kind(k) == "sidewalk"]
    assert len(walks) == 2
    return float(shapely.area(shapely.intersection(tracks, shapely.union_all(walks))))


def as_driven(route: Route) -> Route:
    """The route where a driver takes it: inside of its bends, but where it was fitted."""
    s = np.arange(len(route.position_m), dtype=np.float64) * route.step_m
    _, xy, heading = inside_line(s, route.position_m[:, :2], np.unwrap(route.heading_rad), route.step_m)
    free = np.ones(len(s), bool) if route.fitted is None else ~route.fitted
    xy, heading = xy[: len(s)], heading[: len(s)]
    position = route.position_m.copy()
    position[free, :2] = xy[free]
    return replace(route, position_m=position, heading_rad=np.where(free, heading, route.heading_rad))


def sharpest_radpm(route: Route, window_m: float = 4.0) -> float:
    """Greatest curvature as a mean over a window."""
    n = round(window_m / route.step_m)
    heading = np.unwrap(route.heading_rad)
    return float(np.abs(heading[n:] - heading[:-n]).max() / (n * route.step_m))


def test_sidewalks_lie_low_under_lanes() -> None:
    """Both sidewalks are flush where the other road's lane crosses them, and whole 3 m beside it."""
    network = crossing(0.0)
    east, north = lower_walks(road_strips(network.xodr.roads, network.surface))
    assert np.interp(40.0 + 1.75, east.s_m, east.raised_m[1, 0]) == pytest.approx(-BELOW_M)
    assert np.interp(40.0 - 1.75, north.s_m, north.raised_m[1, 0]) == pytest.approx(-BELOW_M)
    for away in (-3.0, 3.5 + 3.0):
        assert np.interp(40.0 + away, east.s_m, east.raised_m[1, 0]) == pytest.approx(KERB_M)


def test_bridges_leave_sidewalks_alone() -> None:
    """What passes 6 m overhead lowers nothing."""
    network = crossing(6.0)
    strips = road_strips(network.xodr.roads, network.surface)
    assert all(new is old for new, old in zip(lower_walks(strips), strips, strict=True))


def test_a_car_fits_round_a_tight_corner() -> None:
    """Radius 3.4 m becomes one that a car can drive, and it sweeps less beside a lane of 4.5 m."""
    network = corner(3.4, 4.5)
    ends = [(-35.0, -2.25), (3.4, -40.0)]
    middle, fitted = (plan_route(network, ends, fit_turns=fit) for fit in (None, fit_turns))
    assert sharpest_radpm(middle) > 1 / 4.2
    assert sharpest_radpm(fitted) < 1 / 4.7
    assert fitted.fitted is not None
    assert not fitted.fitted[0]
    assert not fitted.fitted[-1]
    assert swept_off_m2(network, fitted) < 0.5 * swept_off_m2(network, middle)
    for end in (0, -1):
        np.testing.assert_allclose(fitted.position_m[end], middle.position_m[end], atol=0.3)


@pytest.mark.parametrize(("radius_m", "width_m"), [(2.0, 4.0), (3.4, 3.2), (4.6, 3.2), (5.6, 2.8)])
def test_tyres_keep_off_kerbs_in_tight_corners(radius_m: float, width_m: float) -> None:
    """Between raised sidewalks, on which tyres climb where the rear axle follows the lane's middle."""
    network = corner(radius_m, width_m, walks=True)
    ends = [(-35.0, -0.5 * width_m), (radius_m, -40.0)]
    middle, fitted = (plan_route(network, ends, fit_turns=fit) for fit in (None, fit_turns))
    assert fitted.fitted is not None
    assert sharpest_radpm(fitted) < 1 / 4.6
    assert on_kerbs_m2(network, middle) > 0.05
    assert on_kerbs_m2(network, as_driven(fitted)) < 0.001


def test_raised_ground_is_what_the_town_raises() -> None:
    """Sidewalks count where they stand up, not where another road's lane crosses them."""
    network = crossing(0.0)
    line = plan_route(network, [(-35.0, -1.75), (35.0, -1.75)])
    own = RouteLine(line.position_m, line.heading_rad, line.slope, line.lane, line.lane_station_m)
    raised, asphalt = raised_near(network, own)
    places = {(10.0, -4.5): (True, False), (1.75, -4.5): (False, True), (10.0, -1.75): (False, True)}
    for (x, y), (up, paved) in places.items():
        assert bool(shapely.contains_xy(raised, x, y)) == up
        assert bool(shapely.contains_xy(asphalt, x, y)) == paved


def test_wide_turns_stay_in_the_middle() -> None:
    """A radius of 6 m is left as it is."""
    network = corner(6.0, 3.5)
    ends = [(-35.0, -1.75), (6.0, -40.0)]
    middle, fitted = (plan_route(network, ends, fit_turns=fit) for fit in (None, fit_turns))
    assert fitted.fitted is None
    np.testing.assert_array_equal(fitted.position_m, middle.position_m)


def test_traffic_suits_the_map() -> None:
    """No walkers where there is no sidewalk, and few vehicles on 83 m of lane."""
    vehicles, walkers = traffic_counts(corner(6.0, 3.5), TrafficCounts())
    assert walkers == 0
    assert vehicles <= 1
    assert traffic_counts(crossing(0.0), TrafficCounts())[1] == 6
    assert traffic_counts(crossing(0.0), TrafficCounts(vehicles=9)) == (9, 6)
