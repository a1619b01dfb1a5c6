"""The scripted driver on streets and in turns, judged by bands of human driving."""

import numpy as np
import pytest
from shared_fixtures.drives.driver_runs import RIGHT_ANGLE, drive, jerk, route_of

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import TICK_HZ, TICK_S
from carlaloc_env.traffic.signals import SignalState

TOWN = (
    (150.0, 0.0), (RIGHT_ANGLE * 13, 1 / 13), (120.0, 0.0), (RIGHT_ANGLE * 10, -1 / 10), (130.0, 0.0),
    (70.0, 1 / 60), (60.0, 0.0), (70.0, -1 / 60), (120.0, 0.0),
)  # fmt: skip


def town_light(time: float) -> SignalState:
    """Red until 38 s, then green."""
    return SignalState.RED if time < 38.0 else SignalState.GREEN


def held_still(log: dict[str, Array]) -> float:
    """Fraction of the driving time in which the wheel turns slower than 1°/s."""
    rate = np.abs(np.diff(log["wheel_deg"])) * TICK_HZ
    return float(np.mean(rate[log["speed"][1:] > 1.0] < 1.0))


def power_above_1_hz(wheel_deg: Array) -> float:
    """Fraction of the steering power above 1 Hz."""
    power = np.abs(np.fft.rfft((wheel_deg - wheel_deg.mean()) * np.hanning(len(wheel_deg)))) ** 2
    frequency = np.fft.rfftfreq(len(wheel_deg), TICK_S)
    return float(power[frequency > 1.0].sum() / power[frequency > 0.0].sum())


@pytest.fixture(scope="module")
def town() -> dict[str, Array]:
    """Straights, two junction turns, two bends of R 60 and a red light, 110 s."""
    return drive(route_of(TOWN, 13.9), 110.0, line_s_m=230.0, light=town_light)


@pytest.fixture(scope="module")
def straight() -> dict[str, Array]:
    """70 s along a straight street at 50 km/h."""
    return drive(route_of([(1000.0, 0.0)], 13.9), 70.0)


def test_begins_with_two_seconds_of_rest(town: dict[str, Array]) -> None:
    still = town["time"] < 2.0
    assert np.abs(town["speed"][still]).max() < 1e-3
    assert np.all(town["brake"][still] > 0.1)
    assert town["speed"][town["time"] < 6.0].max() > 1.0


def test_drives_smoothly(town: dict[str, Array], straight: dict[str, Array]) -> None:
    """Jerk below 3 m/s³ at p99, accelerations of calm town driving."""
    for log in (town, straight):
        assert np.percentile(np.abs(jerk(log["acceleration"])), 99) < 3.0
        assert np.percentile(log["acceleration"], 0.5) > -3.0
        assert log["acceleration"].max() < 2.5
        assert np.abs(jerk(log["acceleration"])).max() < 5.0


def test_keeps_its_lane_as_people_do(straight: dict[str, Array]) -> None:
    """Neither glued to the centre nor wandering."""
    moving = straight["speed"] > 5.0
    assert 0.1 < straight["offset"][moving].std() < 0.3
    assert np.abs(straight["offset"]).max() < 0.8
    assert straight["speed"].max() == pytest.approx(0.97 * 13.9, abs=0.6)


def test_stays_in_its_lane_in_turns(town: dict[str, Array]) -> None:
    """Never more than 1 m off, slow enough for people to sit comfortably."""
    assert np.abs(town["offset"]).max() < 1.0
    edges = np.cumsum([0.0] + [piece[0] for piece in TOWN])
    for k, (_, curvature) in enumerate(TOWN):
        inside = (town["s"] > edges[k]) & (town["s"] < edges[k + 1])
        assert inside.any()
        if curvature:
            lateral = town["speed"][inside] ** 2 * abs(curvature)
            assert 1.5 < np.median(lateral) < 3.0
            assert lateral.max() < 3.5


def test_holds_the_wheel_still(town: dict[str, Array], straight: dict[str, Array]) -> None:
    """The two figures that tell people from controllers (a lane keeper: 2 % still, 77 % above 1 Hz)."""
    assert held_still(straight) > 0.6
    both = np.concatenate([straight["wheel_deg"], town["wheel_deg"]])
    rate = np.abs(np.diff(both)) * TICK_HZ
    assert np.mean(rate < 1.0) > 0.5
    for log in (town, straight):
        assert power_above_1_hz(log["wheel_deg"]) < 0.05
    assert np.abs(np.diff(town["wheel_deg"])).max() * TICK_HZ < 500.0


def test_stops_before_the_line_and_drives_off_on_green(town: dict[str, Array]) -> None:
    red = town["time"] < 38.0
    standing = red & (town["time"] > 6.0) & (np.abs(town["speed"]) < 0.01)
    assert standing.any()
    assert 0.3 < town["line"][standing].min() <= town["line"][standing].max() < 3.0
    after = town["time"][(town["time"] > 38.0) & (town["speed"] > 0.2)][0]
    assert 38.3 < after < 40.5


def test_stops_at_the_end_of_an_open_route(town: dict[str, Array]) -> None:
    length = sum(piece[0] for piece in TOWN)
    assert abs(town["speed"][-1]) < 0.01
    assert length - 3.0 < town["s"][-1] < length


def test_one_foot_for_two_pedals(town: dict[str, Array]) -> None:
    """Never both pedals, and at least 0.3 s between them; a foot needs time to press."""
    throttle, brake = town["throttle"] > 0.02, town["brake"] > 0.02
    assert not np.any(throttle & brake)
    last_throttle, last_brake = -1e9, -1e9
    for tick in range(len(throttle)):
        if throttle[tick]:
            assert tick - last_brake > 0.3 * TICK_HZ
            last_throttle = tick
        if brake[tick]:
            assert tick - last_throttle > 0.3 * TICK_HZ
            last_brake = tick
    for pedal in ("throttle", "brake"):
        assert np.abs(np.diff(town[pedal])).max() * TICK_HZ < 4.0
