"""Raw measurements: each error by itself, as its formula has it, and all of them by seed, name and stamp."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from shared_fixtures.readings.raw_gnss import MODELS, OFF, antenna, config, first_signals, measured, places

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.sensors.raw_gnss.atmosphere import klobuchar_m, saastamoinen_m
from carlaloc_env.sensors.raw_gnss.config import BaseStation, RangeErrors, RawConfig

C = 299_792_458.0
OPEN = RangeErrors(town=False)


def receiver(scenery: Any, errors: RangeErrors, seconds: float = 3.0, **changes: Any) -> list[Any]:
    drive = scenery.drive(scenery.weaving, 60.0)
    return measured(scenery.world(), drive, config(errors, **changes), seconds)["gnss_raw"]


def only(**errors: Any) -> RangeErrors:
    return dataclasses.replace(OFF, **errors)


def test_without_errors_code_and_carrier_are_the_same_distance(scenery: Any) -> None:
    """All carriers of a satellite, phase times wavelength and pseudorange alike, to rounding."""
    (raw, *_) = receiver(scenery, OFF)
    assert len(raw.satellite) > 40
    phase_m = raw.carrier_cycles * C / raw.frequency_hz
    assert np.abs(phase_m - raw.pseudorange_m).max() < 1e-6
    for name in set(raw.satellite):
        assert np.ptp(raw.pseudorange_m[raw.satellite == name]) < 1e-6


def test_position_without_errors_is_the_antenna(scenery: Any) -> None:
    drive = scenery.drive(scenery.weaving, 60.0)
    for errors in (OFF, MODELS):
        samples = measured(scenery.world(), drive, config(errors), 10.0)
        off = places(scenery.world(), samples["gnss"]) - antenna(drive, samples["gnss"])
        assert np.abs(off).max() < 1e-3


def test_doppler_is_the_rate_of_the_phase(scenery: Any) -> None:
    """With clocks, their rates, a drive and the detours of walls: difference over 10 ms, in mm/s."""
    walls = [scenery.box([-400, 8, 0], [400, 20, 25]), scenery.box([-400, -20, 0], [400, -8, 25])]
    world, drive = scenery.world(walls), scenery.drive(scenery.straight(12.0), 3.0)
    errors = only(receiver_clock=True, satellite_clocks=True, town=True)
    raws = measured(world, drive, config(errors, rate_hz=200.0), 1.005)["gnss_raw"]
    before, now, after = raws[99], raws[100], raws[101]
    assert list(before.satellite) == list(now.satellite) == list(after.satellite)
    assert now.way().max() == 1
    rate = (after.carrier_cycles - before.carrier_cycles) / 0.01
    assert np.abs((rate + now.doppler_hz) * C / now.frequency_hz).max() < 5e-3
    assert now.stamp_ns == 500_000_000
    true = drive.ego_motion([now.stamp_ns]).velocity_world_mps[0]
    clear = measured(scenery.world(), drive, config(errors, rate_hz=2.0), 1.0)["gnss_raw"][1]
    assert np.abs(clear.velocity_enu_mps - true).max() < 1e-3


def test_receiver_clock_is_in_ranges_and_in_the_time_that_it_shows(scenery: Any) -> None:
    still, moved = receiver(scenery, OFF)[1], receiver(scenery, only(receiver_clock=True))[1]
    assert 1e-9 < abs(moved.clock_s) <= 0.5e-3
    assert moved.tow_s - still.tow_s == pytest.approx(moved.clock_s, abs=1e-9)
    assert moved.pseudorange_m - still.pseudorange_m == pytest.approx(C * moved.clock_s, abs=1e-6)


def test_the_air_delays_code_and_advances_carrier(scenery: Any) -> None:
    """Klobuchar's delay by 1/f², with opposite signs; Saastamoinen's alike on all."""
    plain, ion, tropo = (
        receiver(scenery, errors)[0] for errors in (OFF, only(ionosphere=1e-9), only(troposphere_m=1e-9))
    )
    delay = ion.pseudorange_m - plain.pseudorange_m
    advance = (plain.carrier_cycles - ion.carrier_cycles) * C / plain.frequency_hz
    assert delay == pytest.approx(advance, abs=1e-5)
    first = first_signals(plain)
    row = {name: k for k, name in enumerate(plain.sky_satellite)}
    at = [row[name] for name in plain.satellite]
    azimuth, elevation = np.radians(plain.sky_azimuth_deg)[at], np.radians(plain.sky_elevation_deg)[at]
    geodetic = np.array(plain.solution_deg_m)
    model = klobuchar_m(geodetic, azimuth, elevation, plain.tow_s) * (1575.42e6 / plain.frequency_hz) ** 2
    assert delay == pytest.approx(model, rel=1e-5)
    assert delay[first].min() > 1.0
    assert tropo.pseudorange_m - plain.pseudorange_m == pytest.approx(
        saastamoinen_m(geodetic, elevation), abs=1e-5
    )


def test_klobuchar_at_night_and_saastamoinen_overhead() -> None:
    """Night: 5 ns times the slant 1 + 16(0.53 − E)³ (IS-GPS-200). Zenith at sea level: 2.3 to 2.5 m."""
    place, up = np.array([49.0, 8.4, 0.0]), np.array([np.pi / 2, np.pi / 6])
    slant = 1.0 + 16.0 * (0.53 - up / np.pi) ** 3
    assert klobuchar_m(place, np.zeros(2), up, 0.0) == pytest.approx(C * 5e-9 * slant)
    zenith, low = saastamoinen_m(place, up)
    assert 2.3 < zenith < 2.5
    assert low == pytest.approx(2 * zenith)
    assert saastamoinen_m(np.array([49.0, 8.4, 5500.0]), up)[0] == pytest.approx(zenith / 2, rel=0.1)


def test_noise_has_the_size_that_samples_promise(scenery: Any) -> None:
    """Code, carrier and Doppler over their standard deviations, of 60 epochs: unit variance, χ² at 4 σ."""
    noisy = only(code_noise_m=0.4, carrier_noise_m=0.001, doppler_noise_mps=0.05)
    clean, raws = receiver(scenery, OFF, 60.0), receiver(scenery, noisy, 60.0)
    parts = []
    for a, b in zip(clean, raws, strict=True):
        off = np.stack([b.pseudorange_m - a.pseudorange_m, b.carrier_cycles - a.carrier_cycles,
                        b.doppler_hz - a.doppler_hz], axis=-1)  # fmt: skip
        parts.append(off / b.sigma)
    units = np.concatenate(parts)
    assert len(units) > 2000
    assert np.abs(np.var(units, axis=0) - 1.0).max() < 4 * np.sqrt(2 / len(units))
    assert np.abs(np.corrcoef(units.T) - np.eye(3)).max() < 4 / np.sqrt(len(units))
    low, high = np.argmin(b.cn0_dbhz), np.argmax(b.cn0_dbhz)
    ratio = 10 ** ((b.cn0_dbhz[high] - b.cn0_dbhz[low]) / 20)
    assert b.sigma[low, 2] / b.frequency_hz[low] == pytest.approx(
        ratio * b.sigma[high, 2] / b.frequency_hz[high]
    )


def test_ambiguities_are_whole_and_slips_are_flagged(scenery: Any) -> None:
    """Phase less range changes by whole cycles exactly where a slip is flagged; one arc, one ambiguity."""
    raws = receiver(scenery, only(ambiguities=True, slips_per_hour=200.0), 60.0)
    clean = receiver(scenery, OFF, 60.0)
    slips, before = 0, {}
    for a, b in zip(clean, raws, strict=True):
        cycles = b.carrier_cycles - a.carrier_cycles
        assert np.abs(cycles - np.rint(cycles)).max() < 1e-3
        now = {key: (round(n), arc, slip) for *key_, n, arc, slip in zip(
            b.satellite, b.code, cycles, b.arc, b.slip, strict=True) for key in [tuple(key_)]}  # fmt: skip
        for key in now.keys() & before.keys():
            changed = now[key][0] != before[key][0]
            assert changed == now[key][2] == (now[key][1] != before[key][1])
            slips += changed
        before = now
    expected = 200 / 3600 * 59 * len(b.satellite)
    assert abs(slips - expected) < 5 * np.sqrt(expected)


def test_satellites_and_air_err_alike_for_two_receivers(scenery: Any) -> None:
    """A base beside the car sees the same errors of orbits, clocks and air: they cancel to a millimetre."""
    errors = only(signal_in_space=1.0, ionosphere=0.5, troposphere_m=0.03, satellite_clocks=True)
    drive = scenery.drive(scenery.straight(0.0), 3.0)
    both = measured(scenery.world(), drive, config(errors, base=BaseStation(position_m=(0.7, 0.1, 1.5))), 2.0)
    car, base = both["gnss_raw"][0], both["gnss_base"][0]
    assert np.abs(car.pseudorange_m - base.pseudorange_m).max() < 1e-3
    clean = measured(
        scenery.world(), drive, config(only(ionosphere=1e-9, troposphere_m=1e-9, satellite_clocks=True)), 1.0
    )
    off = car.pseudorange_m - clean["gnss_raw"][0].pseudorange_m
    assert 0.2 < np.std(off[first_signals(car)]) < 3.0


def test_noise_is_keyed_by_seed_name_and_stamp(scenery: Any) -> None:
    """Any order of stamps, and any stretch, gives the same numbers; another seed or name gives others."""
    drive = scenery.drive(scenery.weaving, 12.0)
    build = config(RangeErrors(town=False), base=BaseStation(position_m=(0.7, 0.1, 1.5))).build
    stamps = [k * 10**9 for k in range(10)]
    whole = build(scenery.world()).measure(drive, stamps)
    backwards = [build(scenery.world()).measure(drive, [stamp]) for stamp in reversed(stamps)]
    for a, b in zip(whole, [one for three in reversed(backwards) for one in three], strict=True):
        for name in ("pseudorange_m", "carrier_cycles", "doppler_hz", "cn0_dbhz", "solution_deg_m", "slip"):
            if hasattr(a, name):
                assert np.array_equal(getattr(a, name), getattr(b, name))
    other = build(scenery.world(seed=2)).measure(drive, stamps[:1])
    assert np.abs(other[1].pseudorange_m - whole[1].pseudorange_m).min() > 1e-3
    assert np.abs(whole[1].pseudorange_m - whole[2].pseudorange_m).min() > 1e-3


def test_errors_of_a_position_are_as_large_as_its_covariance_says(scenery: Any) -> None:
    """NEES per axis over 200 seeds under open sky, by day: between 0.5 and 2 where 1 is perfect."""
    drive, total = scenery.drive(scenery.straight(10.0), 2.0), 0.0
    for seed in range(200):
        world = scenery.world(seed=seed)
        samples = measured(world, drive, config(OPEN, date="2023-01-01T12:00"), 1.0)["gnss"]
        off = places(world, samples)[0] - antenna(drive, samples)[0]
        total += off @ np.linalg.solve(samples[0].covariance_enu_m2, off) / 3
    assert 0.5 < total / 200 < 2.0


def test_settings_that_make_no_sense(scenery: Any) -> None:
    rig = "sensors: [{kind: gnss, raw: true, receiver: %s}]"
    for text, words in (
        ("{date: '1979-05-01'}", "before 1980-01-06"),
        ("{date: 'yesterday'}", "no ISO 8601 date"),
        ("{systems: [gps, gallileo]}", "did you mean 'galileo'"),
        ("{systems: [glonass]}", "no Kepler orbits"),
        ("{systems: []}", "at least one"),
        ("{base: {position_m: [40e3, 40e3, 0]}}", "57 km"),
        ("{errors: {code_noise_m: -1}}", "code_noise_m is -1"),
        ("{errors: {code_nois_m: 1}}", "did you mean 'code_noise_m'"),
    ):
        with pytest.raises(ConfigError, match=words) as caught:
            SensorRig.from_yaml(rig % text)
        assert "\n" not in str(caught.value)
    assert SensorRig.from_yaml(rig % "{errors: {town: false}}").sensors[0].receiver == RawConfig(errors=OPEN)  # type: ignore[attr-defined]
