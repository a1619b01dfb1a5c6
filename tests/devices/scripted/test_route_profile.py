"""The scripted driver in tight turns, round a block, on hills, and twice with one seed."""

import math
from dataclasses import replace

import numpy as np
import pytest
from shared_fixtures.drives.driver_runs import COLUMNS, FRONT_M, RIGHT_ANGLE, drive, route_of

from carlaloc_env.core.clock import TICK_HZ, TICK_S
from carlaloc_env.core.ego import EGO_SIZE_M
from carlaloc_env.traffic.signals import SignalState
from recorder.devices.scripted.driver import ScriptedDriver
from recorder.devices.scripted.route_profile import DriverRoute


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_tight_turns_are_driven_inside(sense: float) -> None:
    """In a turn of R 5 the outer front corner and the inner side keep equal distances from the lane's centre.

    Wide turns and straights are driven in the middle.
    """
    radius, half_width = 5.0, 0.5 * EGO_SIZE_M[1]
    route = route_of([(40.0, 0.0), (math.pi * radius, sense / radius), (40.0, 0.0)], 11.0)
    road = DriverRoute(route, 1.0)
    middle_m = 40.0 + 0.5 * math.pi * radius
    x, y, _ = route.at(middle_m).position_m[0]
    _, outside = road.locate(float(x), float(y), middle_m)
    shift = -sense * outside
    corner = math.hypot(radius - shift + half_width, FRONT_M) - radius
    assert corner == pytest.approx(half_width + shift, abs=0.1)
    assert corner < math.hypot(radius + half_width, FRONT_M) - radius - 0.4
    x, y, _ = route.at(20.0).position_m[0]
    assert road.locate(float(x), float(y), 20.0)[1] == pytest.approx(0.0, abs=1e-6)
    wide = route_of([(40.0, 0.0), (RIGHT_ANGLE * 10.0, sense / 10.0), (40.0, 0.0)], 11.0)
    x, y, _ = wide.at(48.0).position_m[0]
    assert DriverRoute(wide, 1.0).locate(float(x), float(y), 48.0)[1] == pytest.approx(0.0, abs=0.03)


def test_goes_round_a_closed_route() -> None:
    """More than a lap of a block, with the distance along the route growing on."""
    block = route_of([(60.0, 0.0), (RIGHT_ANGLE * 12, 1 / 12)] * 4, 11.0, closed=True)
    log = drive(block, 70.0)
    assert log["s"][-1] > 1.2 * block.length_m
    assert np.abs(log["offset"]).max() < 1.0
    assert log["speed"][log["time"] > 8.0].min() > 3.0


@pytest.mark.parametrize("slope", [0.1, -0.1])
def test_stops_and_starts_on_a_hill(slope: float) -> None:
    """A red light on 10 %: stands before the line, rolls back no more than a hand's breadth."""
    route = route_of([(400.0, 0.0)], 11.0)
    position = route.position_m.copy()
    position[:, 2] = slope * position[:, 0]
    route = replace(route, position_m=position, slope=route.slope + slope)
    log = drive(
        route,
        40.0,
        line_s_m=110.0,
        light=lambda t: SignalState.RED if t < 30.0 else SignalState.GREEN,
        slope=slope,
    )
    assert 0.3 < log["line"][(log["time"] > 28.0) & (log["time"] < 30.0)].min() < 3.0
    assert np.sum(np.minimum(log["speed"], 0.0)) * TICK_S > -0.1
    assert log["speed"][-1] > 5.0


@pytest.mark.parametrize("slope", [-0.03, -0.06])
def test_does_not_creep_down_a_hill(slope: float) -> None:
    """At the end of a route the car comes to rest, also where the road falls more than it looks."""
    route = route_of([(100.0, 0.0)], 8.0)
    position = route.position_m.copy()
    position[:, 2] = slope * position[:, 0]
    log = drive(replace(route, position_m=position), 40.0, slope=slope)
    assert np.abs(log["speed"][-5 * TICK_HZ :]).max() < 0.01
    assert route.length_m - 3.0 < log["s"][-1]


def test_same_seed_same_controls() -> None:
    """Two drivers of a seed, and one driver used twice, do exactly the same; another seed does not."""
    route = route_of([(60.0, 0.0), (RIGHT_ANGLE * 12, 1 / 12), (60.0, 0.0)], 11.0)
    driver = ScriptedDriver(5)
    logs = [drive(route, 14.0, driver=d) for d in (driver, driver, ScriptedDriver(5), ScriptedDriver(6))]
    for name in COLUMNS:
        assert logs[0][name].tobytes() == logs[1][name].tobytes() == logs[2][name].tobytes()
    assert not np.array_equal(logs[0]["wheel_deg"], logs[3]["wheel_deg"])


def test_double_bends_are_driven_slowly() -> None:
    """Bends of 9 m radius: to the same side at 2.4 m/s², 4.65 m/s; to both sides at 1.3 m/s², 3.4 m/s."""
    for second, lateral_mps2 in ((1.0, 2.4), (-1.0, 1.3)):
        route = route_of([(40.0, 0.0), (11.0, 1.0 / 9.0), (11.0, second / 9.0), (40.0, 0.0)], 13.9)
        _, speed_mps = DriverRoute(route, 0.97).speeds_ahead(0.0, 100.0, 0.5)
        assert speed_mps.min() == pytest.approx(math.sqrt(9.0 * lateral_mps2), abs=0.3)
