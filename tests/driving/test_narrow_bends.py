"""Narrow bends: the ego waits before them where its front would swing into an oncoming vehicle."""

import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from shared_fixtures.drives.driver_runs import route_of
from shared_fixtures.worlds.scenes import Scenery

from carlaloc_env.core.ego import EGO_FRONT_M, EGO_SIZE_M
from carlaloc_env.driving.narrow_bends import narrow_bend_m
from carlaloc_env.driving.road_ahead import RoadAhead
from carlaloc_env.map.routing.route import Route
from carlaloc_env.timeline.actors import ActorCatalog, ActorFrame

RADIUS_M = 6.5
"""A village street: two lanes of 2.6 m."""
BEND_M = 40.0
"""Where the bend to the right begins, of 70 degrees [m]."""
LENGTH_M = RADIUS_M * math.radians(70.0)


def street() -> Route:
    """A straight, a bend to the right, a straight."""
    return route_of([(BEND_M, 0.0), (LENGTH_M, -1.0 / RADIUS_M), (80.0, 0.0)], 8.0)


def oncoming(
    route: Route, s_m: float, left_m: float = 2.6, speed_mps: float = 7.0, width_m: float = 2.05
) -> tuple[ActorFrame, ActorCatalog]:
    """A van of 6 m beside a place of the route, in the other direction."""
    at = route.at(s_m)
    heading = float(at.heading_rad[0])
    x, y, _ = at.position_m[0]
    place = [[x - left_m * math.sin(heading), y + left_m * math.cos(heading), 0.0]]
    frame = Scenery.frame(place, heading + math.pi, speed_mps)
    return frame, Scenery.catalog(["van"], size_m=[6.0, width_m, 2.55])


def way_m(route: Route, s_m: float, seen: tuple[ActorFrame, ActorCatalog], speed_mps: float = 5.0) -> float:
    """Way before the ego waits, from a place on its route [m]."""
    ahead = np.arange(0.0, min(100.0, route.length_m - s_m), 1.0)
    return narrow_bend_m(route.at(s_m + ahead), ahead, speed_mps, *seen)


def test_the_ego_waits_before_the_bend() -> None:
    """On an arc of 6.5 m the front's outer corner is √(7.425² + 3.75²) − 6.5 = 1.82 m off the lane's middle.

    The van's side is 2.6 − 1.025 = 1.58 m off: both cannot be in the bend, in which the ego is 3 s from now.
    """
    corner = math.hypot(RADIUS_M + 0.5 * EGO_SIZE_M[1], EGO_FRONT_M) - RADIUS_M
    assert corner == pytest.approx(1.82, abs=0.01)
    assert way_m(street(), 25.0, oncoming(street(), 75.0)) == pytest.approx(BEND_M - 25.0, abs=1.5)


@pytest.mark.parametrize(
    "seen",
    [
        oncoming(street(), 75.0, left_m=3.5),
        oncoming(street(), 75.0, width_m=1.2),
        oncoming(street(), 75.0, speed_mps=0.0),
        oncoming(street(), 120.0, speed_mps=4.0),
        oncoming(street(), 30.0),
    ],
    ids=["wide lanes", "narrow vehicle", "standing", "far away", "through"],
)
def test_these_vehicles_do_not_make_it_wait(seen: tuple[ActorFrame, ActorCatalog]) -> None:
    assert math.isinf(way_m(street(), 25.0, seen))


@pytest.mark.parametrize(("length_m", "width_m", "waits"), [(4.4, 1.8, False), (8.0, 2.5, True)])
def test_long_vehicles_swing_out_in_bends_to_the_left(length_m: float, width_m: float, waits: bool) -> None:
    """A lane of 2.9 m on a bend of 13 m, inside of which a lorry turns on an arc of 10.1 m.

    Its axles, 4.4 m apart, keep its middle 9.86 m from the centre, and the corner is
    √(11.11² + 4²) − 10.1 = 1.71 m off. The ego stops before the bend with its front, and lets a car pass.
    """
    assert math.hypot(math.sqrt(10.1**2 - 2.2**2) + 1.25, 4.0) - 10.1 == pytest.approx(1.71, abs=0.01)
    route = route_of([(BEND_M, 0.0), (18.0, 1.0 / 13.0), (80.0, 0.0)], 8.0)
    frame, _ = oncoming(route, 75.0, left_m=2.9)
    catalog = Scenery.catalog(["van"], size_m=[length_m, width_m, 3.0])
    found = way_m(route, 20.0, (frame, catalog))
    assert math.isfinite(found) == waits
    if waits:
        assert found == pytest.approx(BEND_M - 20.0 - EGO_FRONT_M, abs=2.0)


def test_of_two_that_stand_the_ego_goes() -> None:
    """A van that stands beside the bend is let out while the ego comes; then it may wait for the ego."""
    seen = oncoming(street(), BEND_M + 5.0, speed_mps=0.0)
    assert way_m(street(), BEND_M - 2.0, seen, speed_mps=3.0) < 4.0
    assert math.isinf(way_m(street(), BEND_M - 2.0, seen, speed_mps=0.0))
    assert way_m(street(), BEND_M - 2.0, oncoming(street(), BEND_M + 5.0, speed_mps=2.0), speed_mps=0.0) < 4.0


def test_an_ego_in_the_bend_drives_on() -> None:
    """It would block the bend for both."""
    assert math.isinf(way_m(street(), BEND_M + 2.0, oncoming(street(), 65.0)))


def test_the_driver_sees_where_to_wait() -> None:
    """As a leader that stands there: the van itself is not in the ego's lane, nor on its way into it."""
    route = street()
    road = RoadAhead(cast(Any, SimpleNamespace(signals=[])), route)
    place = route.at(25.0).position_m[0]
    road.start(place)
    state = cast(Any, SimpleNamespace(position_m=place, heading_rad=0.0, speed_mps=5.0))
    actors, catalog = oncoming(route, 75.0)
    view = road.view(
        tick=0,
        state=state,
        acceleration_mps2=0.0,
        actors=actors,
        catalog=catalog,
        signals=np.zeros(0, np.uint8),
    )
    assert view.leader_gap_m == way_m(route, 25.0, (actors, catalog))
    assert view.leader_speed_mps == 0.0
