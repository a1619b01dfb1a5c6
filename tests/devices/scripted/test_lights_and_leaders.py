"""The scripted driver before traffic lights and behind others."""

from collections.abc import Callable

import numpy as np
import pytest
from shared_fixtures.drives.driver_runs import FRONT_M, drive, jerk, route_of

from carlaloc_env.core.clock import TICK_HZ, TICK_S
from carlaloc_env.core.ego import Controls
from carlaloc_env.driving.driver_view import DriverView
from carlaloc_env.traffic.signals import SignalState
from recorder.devices.scripted.driver import ScriptedDriver


@pytest.mark.parametrize("turns_yellow_s", [13.5, 16.0, 17.0])
def test_yellow_light(turns_yellow_s: float) -> None:
    """Either stands before the line or has passed it before red; never stops on it."""

    def light(time: float) -> SignalState:
        if time < turns_yellow_s:
            return SignalState.GREEN
        return SignalState.YELLOW if time < turns_yellow_s + 3.0 else SignalState.RED

    log = drive(route_of([(500.0, 0.0)], 13.9), 29.0, line_s_m=150.0, light=light)
    if log["s"][-1] + FRONT_M < 150.0:
        assert abs(log["speed"][-1]) < 0.01
        assert 0.3 < log["line"][-1] < 3.0
        assert log["acceleration"].min() > -4.5
    else:
        passed = log["time"][log["s"] + FRONT_M > 150.0][0]
        assert passed < turns_yellow_s + 3.0
        assert log["speed"][log["time"] > 10.0].min() > 5.0


@pytest.mark.parametrize("line_m", [8.0, 20.0])
def test_a_red_light_near_the_start(line_m: float) -> None:
    """Drives up to it and stands before it, softly: the last jerk stays below 3 m/s³."""
    log = drive(
        route_of([(200.0, 0.0)], 8.3), 17.0, line_s_m=line_m + FRONT_M, light=lambda t: SignalState.RED
    )
    assert log["speed"].max() > 1.5
    assert abs(log["speed"][-1]) < 0.01
    assert 0.3 < log["line"][-1] < 3.0
    assert np.abs(jerk(log["acceleration"])).max() < 3.0


def following(
    gap_m: float, times: list[float], speeds: list[float]
) -> Callable[[float], tuple[float, float]]:
    """A leader that starts some metres ahead and drives given speeds."""
    grid = np.arange(0.0, 200.0, TICK_S)
    speed = np.interp(grid, times, speeds)
    position = FRONT_M + gap_m + np.cumsum(speed) * TICK_S
    return lambda time: (float(position[round(time * TICK_HZ)]), float(speed[round(time * TICK_HZ)]))


@pytest.mark.parametrize(
    ("times", "speeds"),
    [
        ([0.0, 4.0, 30.0, 34.0, 42.0, 48.0], [0.0, 9.0, 9.0, 0.0, 0.0, 10.0]),
        ([0.0, 5.0, 30.0, 32.2, 200.0], [0.0, 12.0, 12.0, 0.0, 0.0]),
    ],
)
def test_never_hits_the_leader(times: list[float], speeds: list[float]) -> None:
    """Follows at a distance, stops behind, even when the leader brakes with 5.5 m/s²."""
    log = drive(route_of([(900.0, 0.0)], 13.9), 55.0, leader=following(14.0, times, speeds))
    assert np.nanmin(log["gap"]) > 1.5
    cruising = (log["time"] > 24.0) & (log["time"] < 30.0)
    headway = log["gap"][cruising] / log["speed"][cruising]
    assert 1.0 < headway.min() <= headway.max() < 6.0
    standing = (log["time"] > 39.0) & (log["time"] < 42.0)
    if speeds[-1] == 0.0:
        standing = log["time"] > 52.0
    assert np.abs(log["speed"][standing]).max() < 0.1
    assert log["gap"][standing].max() < 6.0
    if speeds[-1] > 0.0:
        assert log["speed"][-1] > 3.0
        assert np.percentile(np.abs(jerk(log["acceleration"])), 99) < 3.0


def test_brakes_hard_for_what_appears_suddenly() -> None:
    """A standing car 24 m ahead at 45 km/h is not hit."""
    stopped_at: list[float] = []
    driver = ScriptedDriver(0)
    route = route_of([(600.0, 0.0)], 13.0)

    def leader(time: float) -> tuple[float, float] | None:
        if time < 18.0:
            return None
        if not stopped_at:
            stopped_at.append(seen["s"] + FRONT_M + 24.0)
        return stopped_at[0], 0.0

    seen = {"s": 0.0}
    read = driver.read

    def watched(view: DriverView) -> Controls:
        seen["s"] = view.route_s_m
        return read(view)

    driver.read = watched  # type: ignore[method-assign]
    log = drive(route, 30.0, driver=driver, leader=leader)
    assert log["speed"][log["time"] < 18.0].max() > 12.0
    assert abs(log["speed"][-1]) < 0.01
    assert np.nanmin(log["gap"]) > 0.5
