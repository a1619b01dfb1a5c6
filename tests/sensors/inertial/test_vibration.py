"""Vibration in the IMU's readings: the road's by ISO 8608, and the motor's."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.signal import welch
from shared_fixtures.imu_readings import QUIET, quiet_imu, read, rows

from carlaloc_env.core.clock import TICK_NS
from carlaloc_env.core.errors import EpisodeError
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.inertial.vibration import body_response
from carlaloc_env.timeline.vehicle_track import CarTrack


def rolling(scenery: Any, speed: float, seconds: float, throttle: float = 1.0) -> Any:
    """A straight drive whose wheels roll without slip."""
    drive = scenery.drive(scenery.straight(speed), seconds)
    ticks = round(seconds * 200) + 2
    spin = np.full((ticks, 4), speed / 0.311)
    controls = np.tile([throttle, 0.0, 0.0, 0.0], (ticks, 1))
    drive.car = CarTrack.from_arrays(spin, np.zeros(ticks), controls)
    return drive


@pytest.mark.parametrize("speed", [8.0, 20.0])
def test_road_vibration_has_the_spectrum_of_iso_8608(scenery: Any, speed: float) -> None:
    """Power of the vertical acceleration in octaves against ∫(2πf)⁴·|H|²·G_d(f) of class C, ±35 %."""
    seconds = 200.0
    drive = rolling(scenery, speed, seconds)
    imu = quiet_imu(road_class="C", mount=Mount(axes="paper_imu")).build(scenery.world())
    stamps = [k * TICK_NS for k in range(round(seconds * 200))]
    up = rows(imu.measure(drive, stamps))[:, 0] - 9.81
    frequency, power = welch(up, fs=200.0, nperseg=8192)
    step = frequency[1]
    for low, high in ((0.8, 1.6), (1.6, 3.2), (3.2, 6.4), (6.4, 12.8), (12.8, 25.6)):
        band = (frequency >= low) & (frequency < high)
        f = frequency[band]
        n = f / speed
        expected = (2 * np.pi * f) ** 4 * np.abs(body_response(f)) ** 2 * 256e-6 * (n / 0.1) ** -2 / speed
        assert power[band].sum() * step == pytest.approx(expected.sum() * step, rel=0.35), (low, high)
    still = rows(imu.measure(rolling(scenery, 0.0, 1.0), stamps[:100]))
    assert np.allclose(still[:, 0], 9.81, atol=1e-12)


def test_quarter_car_follows_slow_roads_and_ignores_fast_ones() -> None:
    """Gain 1 far below the bounce, above 1 near 1.3 Hz, falling beyond the wheel hop."""
    slow, bounce, fast = np.abs(body_response(np.array([0.05, 1.3, 40.0])))
    assert slow == pytest.approx(1.0, abs=0.01)
    assert bounce > 1.3
    assert fast < 0.05


def test_motor_vibration_follows_the_motor(scenery: Any) -> None:
    """At 5 m/s the first order lies at v/(2πr)·9 Hz; full throttle gives the RMS, none a fifth of it."""
    imu = quiet_imu(motor_vibration_mps2=0.5, motor_orders=(1.0, 2.0)).build(scenery.world())
    stamps = [k * TICK_NS for k in range(10, 4000)]  # the drive's jerky first instants left out
    full = rows(imu.measure(rolling(scenery, 5.0, 20.0), stamps))[:, :3] - [0, 0, 9.81]
    assert full.std(axis=0) == pytest.approx([0.5] * 3, rel=0.02)
    frequency, power = welch(full[:, 1], fs=200.0, nperseg=2048)
    assert frequency[np.argmax(power)] == pytest.approx(9 * 5.0 / (2 * np.pi * 0.311), abs=0.15)
    idle = rows(imu.measure(rolling(scenery, 5.0, 20.0, throttle=0.0), stamps))[:, :3] - [0, 0, 9.81]
    assert idle.std() == pytest.approx(0.1, rel=0.02)


def test_vibration_needs_the_wheels(scenery: Any) -> None:
    with pytest.raises(EpisodeError, match="no record of its wheels"):
        read(scenery, scenery.straight(5.0), 0.2, road_class="B", **QUIET)
