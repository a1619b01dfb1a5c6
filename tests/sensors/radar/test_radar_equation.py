"""The radar equation: signal, detection probability, cells, cross sections and rain loss."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from shared_fixtures.readings.radar_scans import STEP, config, frames

from carlaloc_env.samples import RadarScan
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.radar_cross_sections import actor_rcs_dbsm, texture
from carlaloc_env.sensors.radar_equation import (
    RadarEchoes,
    detect,
    errors,
    mean_snr,
    merge_cells,
    rain_loss_db_per_m,
    snr_at,
)
from carlaloc_env.weather.parameters import WeatherParameters

pytest.importorskip("open3d", reason="open3d is not installed")


def echoes(count: int, **columns: Any) -> RadarEchoes:
    """Echoes of 1 m² on the axis at 50 m, unless said otherwise."""
    values: dict[str, Any] = {
        "range_m": 50.0, "azimuth_rad": 0.0, "elevation_rad": 0.0, "doppler_mps": 0.0, "rcs_m2": 1.0,
        "tag": 0, "instance": 0,
    } | columns  # fmt: skip
    kinds = {"tag": np.uint8, "instance": np.uint32}
    return RadarEchoes(
        **{k: np.broadcast_to(np.asarray(v, kinds.get(k, np.float64)), (count,)).copy()
           for k, v in values.items()}
    )  # fmt: skip


def test_reference_and_fourth_power() -> None:
    """Pd at the reference is as configured; twice the distance costs as much as a 1/16 of the target."""
    reference = snr_at(0.9, 1e-6)
    assert 1e-6 ** (1 / (1 + reference)) == pytest.approx(0.9)
    far = mean_snr(
        np.array([100.0, 200.0, 100.0]), np.array([1.0, 1.0, 1 / 16]),
        at_reference=reference, reference_m=100.0, pattern=np.ones(3),
    )  # fmt: skip
    assert far == pytest.approx(reference * np.array([1, 1 / 16, 1 / 16]))


@pytest.mark.parametrize("snr_db", [5.0, 13.0, 21.0])
def test_detection_probability_is_swerlings(snr_db: float) -> None:
    """Pd = Pfa^(1/(1+S)) over 40 000 fluctuating echoes, three standard errors."""
    snr, pfa, count = 10 ** (0.1 * snr_db), 1e-4, 40_000
    uniform = 1.0 - np.random.default_rng(2).random(count)
    seen, measured = detect(np.full(count, snr), pfa, uniform)
    expected = pfa ** (1 / (1 + snr))
    assert len(seen) / count == pytest.approx(expected, abs=3 * math.sqrt(expected / count))
    # What exceeds the threshold does so by an exponential amount of mean 1 + S.
    assert measured.mean() == pytest.approx(-math.log(pfa) + snr, rel=0.1)


@pytest.mark.parametrize("distance", [65.0, 125.0, 175.0])
def test_a_walker_is_found_as_often_as_theory_says(scenery: Any, distance: float) -> None:
    """The whole chain over 300 frames: rays, shares, cells, antenna, R⁻⁴ and Swerling's probability."""
    radar = config(
        azimuth_resolution_deg=30.0, elevation_resolution_deg=30.0, range_resolution_m=10.0,
        doppler_resolution_mps=5.0, columns=1, rows=1,
        mount=Mount(position_m=(0.0, 0.0, -1.0)),
    )  # fmt: skip
    azimuth = math.radians(15.0)
    place = [distance * math.cos(azimuth), distance * math.sin(azimuth), 0.0]
    world = scenery.world([], {"saloon": scenery.box([-0.25, -0.25, 0], [0.25, 0.25, 1.7])})
    catalog = dataclasses.replace(
        scenery.catalog(["saloon"], Tag.PEDESTRIAN), size_m=np.array([[0.5, 0.5, 1.7]], np.float32)
    )
    drive = scenery.drive(scenery.straight(), 15.2, catalog, lambda t: scenery.frame([place], [azimuth]))
    found = [len(scan.range_m) > 0 for scan in frames(world, drive, radar, 300)]
    rcs = actor_rcs_dbsm(np.array([Tag.PEDESTRIAN], np.uint8), np.array([np.pi]))[0]
    antenna = -6.0 * (15 / 60) ** 2
    snr = snr_at(0.9, 1e-6) * 10 ** (0.1 * (rcs + antenna)) * (100 / distance) ** 4
    expected = 1e-6 ** (1 / (1 + snr))
    assert np.mean(found) == pytest.approx(expected, abs=3.3 * math.sqrt(expected * (1 - expected) / 300))


def test_cells_add_up_and_hold_one_detection_each() -> None:
    """Cross-sections in a cell add; the place is their weighted middle; labels are the strongest's."""
    cell = (0.5, 0.1, 0.1, 0.2)
    merged = merge_cells(
        echoes(4, range_m=[10.1, 10.4, 10.1, 30.0], azimuth_rad=[0.01, 0.05, 0.15, 0.01],
               rcs_m2=[1.0, 3.0, 2.0, 5.0], instance=[7, 8, 9, 10]),
        cell,
    )  # fmt: skip
    assert len(merged) == 3
    order = np.argsort(merged.range_m * 100 + merged.azimuth_rad)
    assert sorted(merged.rcs_m2) == [2.0, 4.0, 5.0]
    first = np.flatnonzero(merged.rcs_m2 == 4.0)[0]
    assert merged.range_m[first] == pytest.approx((10.1 + 3 * 10.4) / 4)
    assert merged.azimuth_rad[first] == pytest.approx((0.01 + 3 * 0.05) / 4)
    assert merged.instance[first] == 8
    assert len(order) == 3


def test_errors_fall_with_the_signal_and_have_a_floor() -> None:
    normal = np.random.default_rng(3).standard_normal(20_000)
    for snr_db, expected in ((0.0, 1 / math.sqrt(2)), (10.0, 1 / math.sqrt(20)), (40.0, 0.1)):
        spread = errors(np.full(20_000, 10 ** (0.1 * snr_db)), 0.5, normal).std()
        assert spread == pytest.approx(0.5 * expected, rel=0.03)


def test_scenery_keeps_its_strength_from_frame_to_frame() -> None:
    """Weibull clutter of shape ½: mean 1, variance 5; the same patch gives the same number."""
    points = np.random.default_rng(4).uniform(-500, 500, (200_000, 3))
    strength = texture(points)
    assert strength.mean() == pytest.approx(1.0, abs=0.03)
    assert strength.var() == pytest.approx(5.0, rel=0.15)
    corner = np.floor(points / 0.5) * 0.5
    assert np.array_equal(texture(corner + 0.05), texture(corner + 0.45))
    assert abs(np.corrcoef(strength, texture(points + np.array([0.5, 0, 0])))[0, 1]) < 0.02


def test_cross_section_by_aspect() -> None:
    """Flanks flash, corners are weak, and the shape is even about the car's axis."""
    car = np.full(5, Tag.CAR, np.uint8)
    front, corner, side, back, other = actor_rcs_dbsm(car, np.radians([0, 45, 90, 180, -90]))
    assert front == pytest.approx(11.0, abs=0.2)
    assert side == pytest.approx(18.0, abs=0.2)
    assert back == pytest.approx(13.0, abs=0.2)
    assert corner < front
    assert other == pytest.approx(side)


def test_rain_loss_is_the_recommendations() -> None:
    """k and α against the closed forms of ITU-R P.838-3 at 77 GHz, horizontal polarisation."""
    log_f = math.log10(77.0)

    def bells(a: list[float], b: list[float], c: list[float]) -> float:
        return sum(x * math.exp(-(((log_f - y) / z) ** 2)) for x, y, z in zip(a, b, c, strict=True))

    k = 10 ** (
        bells([-5.33980, -0.35351, -0.23789, -0.94158], [-0.10008, 1.26970, 0.86036, 0.64552],
              [1.13098, 0.45400, 0.15354, 0.16817]) - 0.18961 * log_f + 0.71147
    )  # fmt: skip
    alpha = bells(
        [-0.14318, 0.29591, 0.32177, -5.37610, 16.1721], [1.82442, 0.77564, 0.63773, -0.96230, -3.29980],
        [-0.55187, 0.19822, 0.13164, 1.47828, 3.43990],
    ) + 0.67849 * log_f - 1.95537  # fmt: skip
    for rain in (1.0, 10.0, 50.0):
        assert rain_loss_db_per_m(rain) == pytest.approx(1e-3 * k * rain**alpha, rel=0.02)
    assert rain_loss_db_per_m(0.0) == 0.0


def test_rain_weakens_echoes_when_asked(scenery: Any) -> None:
    """Two-way loss over 150 m in 50 mm/h; the same fluctuation under both weathers."""
    world = scenery.world([scenery.box([150, -60, -40], [151, 60, 60], tag=Tag.GUARD_RAIL)])
    drive = scenery.drive(scenery.straight(), 0.3)
    clear, rain = WeatherParameters(), WeatherParameters(precipitation=100.0)
    sensor = config(weather=True, reference_pd=0.9999, detections_max=5000).build(world)
    (dry,), (wet,) = sensor.measure_conditions(drive, STEP, [clear, rain])
    assert isinstance(dry, RadarScan)
    assert isinstance(wet, RadarScan)
    assert sensor.depends_on_weather
    assert len(wet.range_m) < len(dry.range_m)
    fall = np.mean(10 ** (0.1 * dry.snr_db)) / np.mean(10 ** (0.1 * wet.snr_db))
    assert 10 * math.log10(fall) == pytest.approx(2 * 150 * rain_loss_db_per_m(50.0), abs=1.0)
    assert config().build(world).depends_on_weather is False
