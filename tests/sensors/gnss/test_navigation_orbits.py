"""Orbits of navigation messages: nominal constellations, light time, and records that agree."""

import numpy as np
import pytest

from carlaloc_env.core.geodesy import geodetic_to_ecef
from carlaloc_env.sensors.raw_gnss.orbits import Sky, ephemerides
from carlaloc_env.sensors.raw_gnss.systems import SYSTEMS

C = 299_792_458.0
SPIN = 7.2921151467e-5
GPS_S = 1_356_566_418
"""2023-01-01T00:00:00 UTC."""
PLACE = geodetic_to_ecef([49.0, 8.4, 115.0])


def inertial(ecef: np.ndarray, time_s: float, spin: float = SPIN) -> np.ndarray:
    """Earth-fixed points at a time in axes that do not turn."""
    c, s = np.cos(spin * time_s), np.sin(spin * time_s)
    return ecef @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]).T


@pytest.mark.parametrize("name", sorted(SYSTEMS))
def test_orbits_are_kepler_circles_in_evenly_tilted_planes(name: str) -> None:
    """Radius, tilt and speed √(μ/r) of all satellites, by the inertial velocity; Earth's rate per system."""
    system = SYSTEMS[name]
    sky = Sky(ephemerides([name], GPS_S))
    ecef, velocity = sky.at(GPS_S * 10**9)
    turning = system.earth_rate_radps * np.stack([-ecef[:, 1], ecef[:, 0], 0 * ecef[:, 0]], axis=-1)
    assert np.linalg.norm(ecef, axis=1) == pytest.approx(system.radius_m)
    speed = np.linalg.norm(velocity + turning, axis=1)
    assert speed == pytest.approx(np.sqrt(system.gm_m3ps2 / system.radius_m), rel=3e-4)
    normal = np.cross(ecef, velocity + turning)
    tilt = np.degrees(np.arccos(normal[:, 2] / np.linalg.norm(normal, axis=1)))
    assert tilt == pytest.approx(system.inclination_deg, abs=0.01)
    assert len(set(np.round(np.degrees(np.arctan2(normal[:, 1], normal[:, 0])) % 360, 1))) == len(
        system.nodes_deg
    )


def test_velocity_is_the_change_of_place() -> None:
    sky = Sky(ephemerides(list(SYSTEMS), GPS_S))
    before, after = (sky.at(GPS_S * 10**9 + step)[0] for step in (-500_000_000, 500_000_000))
    assert np.abs(after - before - sky.at(GPS_S * 10**9)[1]).max() < 1e-3


def test_gps_planes_lie_where_the_standard_has_them() -> None:
    """Slots A1 and C2 at the epoch of table 3.2-1, 1993-07-01, by spherical trigonometry.

    The table's sidereal time, 18h36m14.4s, is 1.1 s later than the formula's: 8e-5 rad.
    """
    epoch_s = 741_484_800 - 315_964_800
    sky = Sky(ephemerides(["gps"], epoch_s))
    gmst = np.radians(15.0 * (18 + 36 / 60 + 14.4 / 3600))
    for slot, node, along in ((0, 272.847, 268.126), (9, 32.847, 11.796)):
        ecef = sky.at(epoch_s * 10**9)[0][slot] / 26_559_710.0
        c, s = np.cos(gmst), np.sin(gmst)
        x, y = c * ecef[0] - s * ecef[1], s * ecef[0] + c * ecef[1]
        u, i, o = np.radians([along, 55.0, node])
        expected = [
            np.cos(u) * np.cos(o) - np.sin(u) * np.cos(i) * np.sin(o),
            np.cos(u) * np.sin(o) + np.sin(u) * np.cos(i) * np.cos(o),
            np.sin(u) * np.sin(i),
        ]
        assert np.allclose([x, y, ecef[2]], expected, atol=1e-4)


def test_successive_records_are_one_orbit_and_one_clock() -> None:
    """At the same time, records of two hours later give the same place to a millimetre."""
    early, late = (Sky(ephemerides(list(SYSTEMS), GPS_S + shift)) for shift in (0, 7200))
    assert all(a.toe_s < b.toe_s for a, b in zip(early.records, late.records, strict=True))
    now = (GPS_S + 3600) * 10**9
    assert np.abs(early.at(now)[0] - late.at(now)[0]).max() < 2e-3
    assert np.abs(early.clock_s(now) - late.clock_s(now)).max() < 1e-15
    galileo = [r for r in early.records if r.system.letter == "E"]
    assert all(GPS_S - 600 <= record.toe_s < GPS_S for record in galileo)


def test_light_travels_straight_in_axes_that_do_not_turn() -> None:
    """|satellite(t − τ) − antenna(t)| = c·τ in inertial axes, τ by bisection: Sagnac's effect, its rate."""
    sky = Sky(ephemerides(["gps", "galileo"], GPS_S))
    now, velocity = GPS_S * 10**9, np.array([-7.0, 12.0, 3.0])

    def distance(step_s: float) -> np.ndarray:
        antenna = inertial(PLACE + velocity * step_s, step_s)
        low, high = np.full(48, 0.05), np.full(48, 0.12)
        for _ in range(60):
            middle = 0.5 * (low + high)
            ecef = sky.at(now, middle - step_s)[0]
            sent = np.array([inertial(p, step_s - tau) for p, tau in zip(ecef, middle, strict=True)])
            far = np.linalg.norm(sent - antenna, axis=1) > C * middle
            low, high = np.where(far, middle, low), np.where(far, high, middle)
        return np.asarray(C * 0.5 * (low + high))

    _, ranges, rates = sky.seen_from(PLACE, velocity, now)
    assert np.abs(ranges - distance(0.0)).max() < 1e-4
    assert np.abs(rates - (distance(0.5) - distance(-0.5))).max() < 1e-4


def test_group_delays_fall_with_the_square_of_the_carrier() -> None:
    """GPS and Galileo: none in the combination without an ionosphere on two carriers. BeiDou: none on B3."""
    for record in ephemerides(list(SYSTEMS), GPS_S)[::7]:
        first, second, *_ = (signal.frequency_hz for signal in record.system.signals)
        if record.system.letter == "C":
            assert record.delay_s(1268.52e6) == pytest.approx(0.0, abs=1e-20)
        else:
            gamma = (first / second) ** 2
            assert record.delay_s(first) == record.group_delay_s
            assert record.delay_s(second) == pytest.approx(gamma * record.group_delay_s)
