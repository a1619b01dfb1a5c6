"""Crossing and standing traffic: who is in the way of the ego, and who is not."""

import math

import numpy as np
import pytest
from shared_fixtures.drives.driver_runs import route_of
from shared_fixtures.worlds.scenes import Scenery

from carlaloc_env.driving.crossing_traffic import crossing_traffic, standing_gap_m
from carlaloc_env.driving.road_ahead import SIGHT_M
from carlaloc_env.map.routing.route import Route
from carlaloc_env.timeline.actors import (
    ActorCatalog,
    ActorFrame,
    empty_catalog,
    empty_frame,
)

FRONT_M = 3.75


def eastward() -> Route:
    """A straight route of 200 m along the x axis."""
    return route_of([(200.0, 0.0)], 13.9)


def car(
    x_m: float, y_m: float, heading_rad: float, speed_mps: float, z_m: float = 0.0
) -> tuple[ActorFrame, ActorCatalog]:
    """One saloon."""
    frame = Scenery.frame([[x_m, y_m, z_m]], heading_rad, speed_mps)
    return frame, Scenery.catalog(["saloon"], size_m=[4.5, 1.8, 1.5])


def test_a_car_that_crosses_at_the_same_time_counts() -> None:
    """25 m ahead, from the right, there in 2 s; the ego at 10 m/s as well."""
    found = crossing_traffic(eastward(), 20.0, 10.0, *car(45.0, -16.0, math.pi / 2, 8.0))
    assert found is not None
    gap, speed = found
    assert gap == pytest.approx(25.0 - FRONT_M - 0.9, abs=1.5)
    assert speed == pytest.approx(0.0, abs=0.01)


def test_a_car_that_merges_brings_its_speed() -> None:
    """At 30° to the route: a leader to be, with cos 30° of its speed."""
    found = crossing_traffic(eastward(), 20.0, 8.0, *car(30.0, -7.0, math.radians(30.0), 7.0))
    assert found is not None
    assert found[1] == pytest.approx(7.0 * math.cos(math.radians(30.0)), abs=0.01)


@pytest.mark.parametrize(
    ("ego_mps", "speed_mps", "waits"),
    [(1.5, 12.0, True), (4.3, 12.0, True), (1.5, 6.0, False), (6.0, 12.0, False)],
)
def test_an_ego_that_starts_waits_for_a_faster_stream(ego_mps: float, speed_mps: float, waits: bool) -> None:
    """A left turn into a street on which a car comes from the left; an ego at its speed would merge."""
    route = route_of([(20.0, 0.0), (12.0 * math.pi / 2, 1.0 / 12.0), (60.0, 0.0)], 8.0)
    found = crossing_traffic(
        route, 20.0, ego_mps, *car(32.0, -2.5 * speed_mps + 12.0, math.pi / 2, speed_mps)
    )
    assert found is not None
    assert (found[1] == 0.0) == waits


@pytest.mark.parametrize(
    ("x_m", "y_m", "heading_rad", "speed_mps", "z_m"),
    [
        (50.0, 3.5, math.pi, 13.0, 0.0),
        (40.0, 3.5, 0.0, 10.0, 0.0),
        (10.0, 0.0, 0.0, 12.0, 0.0),
        (45.0, -16.0, math.pi / 2, 0.0, 0.0),
        (45.0, 6.0, math.pi / 2, 8.0, 0.0),
        (55.0, -16.0, math.pi / 2, 8.0, 6.0),
    ],
    ids=["oncoming", "next lane", "behind", "waiting", "already across", "on a bridge"],
)
def test_others_do_not_count(
    x_m: float, y_m: float, heading_rad: float, speed_mps: float, z_m: float
) -> None:
    assert crossing_traffic(eastward(), 20.0, 10.0, *car(x_m, y_m, heading_rad, speed_mps, z_m)) is None


def test_well_before_or_well_after_does_not_count() -> None:
    """The ego passes 5 s before a far car; a near car has crossed long before the ego comes."""
    assert crossing_traffic(eastward(), 20.0, 14.0, *car(30.0, -26.0, math.pi / 2, 8.0)) is None
    assert crossing_traffic(eastward(), 20.0, 4.0, *car(58.0, -5.0, math.pi / 2, 10.0)) is None


def test_empty_road() -> None:
    assert crossing_traffic(eastward(), 20.0, 10.0, empty_frame(), empty_catalog()) is None


def gap_to(route: Route, s_m: float, seen: tuple[ActorFrame, ActorCatalog]) -> float:
    """Way before the ego touches a standing car [m], from a place on its route."""
    ahead = np.arange(0.0, min(SIGHT_M, route.length_m - s_m), 1.0)
    return standing_gap_m(route.at(s_m + ahead), ahead, *seen)


def test_the_way_to_a_standing_car_is_exact() -> None:
    """Its rear is at 59.3 - 2.25 m, the ego's front at 20 + 3.75 m; across the road half its width counts."""
    assert gap_to(eastward(), 20.0, car(59.3, 0.4, 0.0, 0.0)) == pytest.approx(33.3)
    assert gap_to(eastward(), 20.0, car(59.3, 2.0, math.pi / 2, 0.0)) == pytest.approx(34.65)


@pytest.mark.parametrize(
    ("x_m", "y_m", "speed_mps", "z_m"),
    [(60.0, 2.2, 0.0, 0.0), (60.0, 0.0, 5.0, 0.0), (10.0, 0.0, 0.0, 0.0), (60.0, 0.0, 0.0, 6.0)],
    ids=["beside the path", "moving", "behind", "on a bridge"],
)
def test_these_cars_do_not_stand_in_the_way(x_m: float, y_m: float, speed_mps: float, z_m: float) -> None:
    assert math.isinf(gap_to(eastward(), 20.0, car(x_m, y_m, 0.0, speed_mps, z_m)))


@pytest.mark.parametrize(("room_m", "hits"), [(0.55, True), (0.95, False)])
def test_the_front_swings_out_in_a_bend(room_m: float, hits: bool) -> None:
    """A right turn of radius 12 m: the front's outer corner reaches 0.53 m beyond the path's edge.

    With 0.25 m of room it is a circle of radius hypot(12 + 0.925 + 0.25, 3.75) = 13.70 m. A car outside the
    bend, square to its radius, counts if its side is closer to the centre; each side is beyond the path's
    edge and the room.
    """
    radius = 12.0
    route = route_of([(30.0, 0.0), (40.0, -1.0 / radius), (20.0, 0.0)], 8.0)
    middle = route.at(50.0)
    across = float(middle.heading_rad[0]) + math.pi / 2
    x, y, _ = middle.position_m[0]
    away = 0.925 + room_m + 0.9
    found = gap_to(
        route, 25.0, car(x + away * math.cos(across), y + away * math.sin(across), across - math.pi / 2, 0.0)
    )
    assert (radius + 0.925 + room_m < math.hypot(radius + 0.925 + 0.25, FRONT_M)) == hits
    assert math.isfinite(found) == hits


def test_a_car_too_near_beside_the_ego_is_still_in_its_way() -> None:
    """Askew, 0.1 m from its side, it would be hit at once; along the road it is passed."""
    assert gap_to(eastward(), 26.0, car(31.0, 1.6, -0.3, 0.0)) == 0.0
    assert math.isinf(gap_to(eastward(), 26.0, car(27.0, 1.925, 0.0, 0.0)))
