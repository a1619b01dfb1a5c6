"""Wheels and pedals over time: live, replayed and forgetting tracks agree to the last bit."""

import numpy as np
import pytest

from carlaloc_env.core.clock import TICK_NS
from carlaloc_env.core.ego import Controls
from carlaloc_env.core.errors import EpisodeError
from carlaloc_env.timeline.vehicle_track import CarTrack

SPINS = np.random.default_rng(1).normal(30.0, 5.0, (900, 4))
STEER = 0.3 * np.sin(np.arange(900) / 70.0)


def controls(tick: int) -> Controls:
    return Controls(throttle=(tick % 50) / 50, brake=(tick % 7) / 7, reverse=tick > 600, handbrake=tick < 9)


def live() -> CarTrack:
    track = CarTrack()
    for tick in range(900):
        track.append(SPINS[tick], STEER[tick], controls(tick))
    return track


def whole() -> CarTrack:
    rows = [controls(tick) for tick in range(900)]
    columns = [(c.throttle, c.brake, float(c.reverse), float(c.handbrake)) for c in rows]
    return CarTrack.from_arrays(SPINS, STEER, np.array(columns))


def test_live_equals_whole_and_forgetting() -> None:
    stamps = np.arange(800 * TICK_NS, 898 * TICK_NS, 1_700_000)
    forgetful = live()
    forgetful.forget_before(700)
    forgetful.forget_before(650)
    expected = whole().at(stamps)
    for track in (live(), forgetful):
        found = track.at(stamps)
        for name in expected.__slots__:
            assert np.array_equal(getattr(found, name), getattr(expected, name)), name
        one = [track.one_at(stamp) for stamp in stamps.tolist()]
        mean_rad = expected.wheel_angle_rad.sum(axis=1) * 0.25
        alike = (mean_rad, expected.road_wheel_rad, expected.brake, expected.reverse)
        assert np.array_equal(one, np.column_stack(alike))


def test_angle_is_the_integral_of_the_spin() -> None:
    """Constant spin turns evenly, between ticks as well."""
    track = CarTrack.from_arrays(np.full((401, 4), 20.0), np.zeros(401), np.zeros((401, 4)))
    state = track.at([0, 1_000_000_000, 1_002_500_000])
    assert state.wheel_angle_rad[:, 2] == pytest.approx([0.0, 20.0, 20.05])
    assert state.wheel_spin_radps[:, 0] == pytest.approx([20.0] * 3)


def test_switches_hold_and_pedals_run_straight() -> None:
    state = whole().at([600 * TICK_NS + TICK_NS // 2, 51 * TICK_NS + TICK_NS // 2])
    assert state.reverse.tolist() == [False, False]
    assert state.throttle == pytest.approx([0.01, 0.03])


def test_unknown_times_and_drives_are_refused() -> None:
    with pytest.raises(EpisodeError, match="no record of its wheels"):
        CarTrack().at([0])
    short = live()
    short.forget_before(100)
    with pytest.raises(EpisodeError, match="from tick 100 to 899"):
        short.at([99 * TICK_NS])
