"""One lap of Town03 by the scripted driver among traffic, judged as a drive of a person would be."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.signal import welch

from carlaloc_env.town.build import load_town
from recorder.drive.record import RecordConfig, record
from recorder.episode.episode import Episode
from recorder.episode.summary import summarise

STEERING_RATIO = 12.0


@pytest.fixture(scope="module")
def lap(tmp_path_factory: pytest.TempPathFactory) -> Episode:
    """The whole route, until it is closed."""
    path = tmp_path_factory.mktemp("lap") / "lap.mcap"
    record(RecordConfig(out=path, seed=3, traffic="dynamic,vehicles=20,walkers=5,green_wave=true"))
    return Episode.load(path)


def test_the_loop_is_that_of_the_paper(lap: Episode) -> None:
    """970 m within 1 %, closed within 5 m and 10°, without a collision."""
    summary = summarise(lap)
    assert summary.driven_m == pytest.approx(969.64, rel=0.01)
    assert summary.loop_closed
    assert summary.collisions == 0


def test_the_car_stands_for_two_seconds_first(lap: Episode) -> None:
    """Inertial systems calibrate while nothing moves."""
    assert np.abs(lap.ego["speed_mps"][: 2 * 200]).max() < 0.01
    moved = lap.ego["position_m"][: 2 * 200] - lap.ego["position_m"][0]
    assert np.abs(moved).max() < 0.005


def test_pedals_are_smooth(lap: Episode) -> None:
    """99 % of the longitudinal jerk, smoothed over half a second, lies below 3 m/s³."""
    acceleration = np.gradient(uniform_filter1d(lap.ego["speed_mps"], 100), 0.005)
    assert np.percentile(np.abs(np.gradient(acceleration, 0.005)), 99) < 3.0


def test_the_car_keeps_its_lane_as_a_person_does(lap: Episode) -> None:
    """0.1 to 0.3 m of deviation where the road is straight, never 1 m anywhere."""
    route = load_town("Town03").route
    assert route is not None
    offset: list[float] = []
    bend: list[float] = []
    near: float | None = None
    for position in lap.ego["position_m"][::20]:
        near, side = route.project(position, near)
        offset.append(side)
        bend.append(abs(float(route.at(near).curvature_radpm[0])))
    straight = np.array(bend) < 0.002
    assert 0.1 < np.array(offset)[straight].std() < 0.3
    assert np.abs(offset).max() < 1.0


def _wheel_deg(lap: Episode) -> NDArray[np.float64]:
    wheel: NDArray[np.float64] = np.degrees(lap.ego["road_wheel_rad"]) * STEERING_RATIO
    return wheel


def test_the_wheel_is_held_still_most_of_the_time(lap: Episode) -> None:
    """It turns by less than 1°/s more than half of the time, though half of the lap is bends."""
    rate = np.gradient(uniform_filter1d(_wheel_deg(lap), 20), 0.005)
    assert (np.abs(rate) < 1.0).mean() > 0.5


def test_the_wheel_does_not_chatter(lap: Episode) -> None:
    """At most 5 % of the steering's power lies above 1 Hz; a PID lane keeper has 77 % there."""
    moving = lap.ego["speed_mps"] > 1.0
    frequency_hz, power = welch(_wheel_deg(lap)[moving], fs=200, nperseg=4096)
    assert power[frequency_hz > 1.0].sum() <= 0.05 * power.sum()
