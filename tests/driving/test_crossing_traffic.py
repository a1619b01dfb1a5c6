"""Crossing traffic seen from a straight road: who is in the way, and who is not."""

import math

import pytest
from shared_fixtures.drives.driver_runs import route_of
from shared_fixtures.worlds.scenes import Scenery

from carlaloc_env.driving.road_ahead import crossing_traffic
from carlaloc_env.timeline.timeline import ActorCatalog, ActorFrame, empty_catalog, empty_frame
from carlaloc_env.town.routing.route import Route

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
