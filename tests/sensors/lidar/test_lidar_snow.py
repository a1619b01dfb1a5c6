"""Snow in LiDAR scans: flakes against theory and real snow, white ground, and nothing without weather."""

import math
from typing import Any

import numpy as np
import pytest
from shared_fixtures.readings.lidar_scans import MOUNT
from shared_fixtures.readings.lidar_weather import HEIGHT, POWER_MIN, model, ranges, semantic

from carlaloc_env.road.wheel_tracks import TRACK_M, WheelTracks
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.lidar.atmosphere import DropEcho, atmosphere_at
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.weather.parameters import WeatherParameters
from carlaloc_env.weather.presets import PRESETS
from carlaloc_env.weather.snowfall import extinction_per_m

pytest.importorskip("open3d", reason="open3d is not installed")

lidar = pytest.importorskip("carlaloc_env.sensors.lidar.lidar")


def test_strongest_flake_has_the_distribution_of_simulated_flakes() -> None:
    """White balls of 0.1 g/cm³ scattered into beams one by one, seen out of focus, against Λ(p)."""
    weather = WeatherParameters(snowfall=2.5, fog_density=0.0, mie_scattering_scale=0.0)
    air, beam, near, far = atmosphere_at(weather, 0.0), 3e-3, 1.0, 8.0
    echo = DropEcho(air, divergence_rad=beam, range_min_m=near, power_min=POWER_MIN, range_limit_m=far)
    rng = np.random.default_rng(1)
    swollen = 10.0 ** (1 / 3)
    slope, least = 2550.0 * 2.5**-0.48 / swollen, 0.05e-3
    cone = math.pi / 3 * math.tan(beam / 2) ** 2
    intercept = 3.8e6 * 2.5**-0.87 / swollen
    number = intercept / slope * math.exp(-slope * least) * cone * (far**3 - near**3)
    strongest, away_m = np.zeros(6000), np.zeros(6000)
    for k in range(len(strongest)):
        count = rng.poisson(number)
        r = (near**3 + rng.random(count) * (far**3 - near**3)) ** (1 / 3)
        size = -np.log(1 - rng.random(count)) / slope + least
        filled = np.minimum((size / (2 * r * math.tan(beam / 2))) ** 2, 1.0)
        seen = (1 - np.exp(-((r / 16.0) ** 2))) * np.exp(-2 * extinction_per_m(2.5) * r) / r**2
        power = np.append(0.6 * seen * filled, 0.0)
        strongest[k], away_m[k] = power.max(), np.append(r, 0.0)[power.argmax()]
    drawn, at_m = echo.draw(1.0 - rng.random((40_000, 2)), np.zeros(40_000))
    for p in (POWER_MIN, 3 * POWER_MIN, 10 * POWER_MIN):
        simulated = np.mean(strongest > p)
        assert np.mean(drawn > p) == pytest.approx(simulated, abs=0.008 + 3 * math.sqrt(simulated / 6000))
    found, expected = at_m[drawn > POWER_MIN], away_m[strongest > POWER_MIN]
    for quarter in (0.25, 0.5, 0.75):
        assert np.quantile(found, quarter) == pytest.approx(np.quantile(expected, quarter), abs=0.35)


def test_flakes_are_tagged_and_as_many_as_their_rate_has(scenery: Any) -> None:
    """Into the sky, where nothing else returns: the share of beams is 1 − exp(−Λ(P_min))."""
    world, drive = scenery.world([]), scenery.drive(scenery.straight(), 0.2)
    config = model(range_min_m=1.0)
    shares = []
    for snowfall in (0.2, 1.0, 2.5):
        weather = WeatherParameters(snowfall=snowfall, fog_density=0.0, mie_scattering_scale=0.0)
        cloud = semantic(world, drive, config, weather)
        echo = DropEcho(
            atmosphere_at(weather, HEIGHT), divergence_rad=3e-3, range_min_m=1.0, power_min=POWER_MIN
        )
        mean = float(np.interp(math.log(POWER_MIN), np.log(echo.power), echo.expected))
        shares.append(len(cloud.points_xyz_m) / config.rays)
        assert shares[-1] == pytest.approx(1 - math.exp(-mean), rel=0.1, abs=5e-4)
        assert cloud.tag is not None
        assert set(cloud.tag.tolist()) == {Tag.SNOW}
    assert shares[0] < shares[1] < shares[2]


def test_flakes_of_a_street_are_those_of_real_snow(scenery: Any, town03: Any) -> None:
    """Shares of points, ranges and lowest intensity (WADS) with an HDL-32E at 1 mm/h, at three places."""
    stage = SensorStage(town03, seed=1, weather=PRESETS["SnowyNoon"])
    middles_m = town03.network.driven_middles_m
    config = LidarConfig(mount=MOUNT, **{**LidarConfig.preset_values("hdl32e_road"), "weather": True})
    tags, ranges_m, intensity = [], [], []
    for k in (len(middles_m) // 7, len(middles_m) // 2, 5 * len(middles_m) // 6):
        drive = scenery.drive(lambda t, k=k: (np.tile(middles_m[k], (len(t), 1)), np.zeros((len(t), 3))), 0.2)
        cloud = config.build(stage).measure(drive, [0])[1]
        tags.append(cloud.tag == Tag.SNOW)
        ranges_m.append(ranges(cloud)[tags[-1]])
        intensity.append(cloud.intensity[tags[-1]])
    assert 0.02 < np.concatenate(tags).mean() < 0.12
    for reach_m, share in ((5.0, 0.58), (10.0, 0.91), (15.0, 0.98)):
        assert np.mean(np.concatenate(ranges_m) <= reach_m) == pytest.approx(share, abs=0.15)
    assert np.mean(np.concatenate(intensity) == 0.0) > 0.6


def test_ground_is_white_but_in_wheel_tracks_and_keeps_its_labels(scenery: Any) -> None:
    """No snow falls: points, labels and ranges are those of the bare ground, intensities are not."""
    world, drive = scenery.world([scenery.ground()]), scenery.drive(scenery.straight(), 0.2)
    x = np.arange(-60.0, 60.0, 0.5)
    tracks = WheelTracks.of(np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=1))
    world.wheel_tracks = lambda: tracks
    config = model(attenuation_per_m=0.0)
    bare = semantic(world, drive, config, WeatherParameters(fog_density=0.0))
    white = semantic(world, drive, config, WeatherParameters(fog_density=0.0, snow_cover=1.0))
    near = len(bare.points_xyz_m)
    assert len(white.points_xyz_m) >= near
    left_m = white.points_xyz_m[:, 1]
    close = ranges(white) < 12.0
    track = close & (np.abs(np.abs(left_m) - TRACK_M) < 0.08)
    verge = close & (np.abs(left_m) > 3.0)
    share = white.intensity / np.maximum(white.cos_incidence, 0.01)
    assert share[verge].mean() == pytest.approx(80.0, rel=0.02)
    assert share[track].mean() < 40.0
    assert white.tag is not None
    assert bare.tag is not None
    assert set(white.tag.tolist()) == set(bare.tag.tolist())


def test_half_of_the_ground_is_white_under_half_a_cover(scenery: Any) -> None:
    world, drive = scenery.world([scenery.ground()]), scenery.drive(scenery.straight(), 0.2)
    cloud = semantic(world, drive, model(), WeatherParameters(fog_density=0.0, snow_cover=0.5))
    near = ranges(cloud) < 25.0
    share = cloud.intensity[near] / np.maximum(cloud.cos_incidence[near], 0.01)
    assert np.mean(share > 55.0) == pytest.approx(0.5, abs=0.12)


def test_without_weather_sweeps_are_those_of_clear_noon(scenery: Any) -> None:
    world, drive = scenery.world([scenery.ground()]), scenery.drive(scenery.weaving, 0.3)
    off = lidar.LidarConfig(mount=Mount(position_m=(1.2, 0, HEIGHT))).build(world)
    names = ("ClearNoon", "SnowyNoon", "WinterNoon")
    clear, snowy, winter = off.measure_conditions(drive, 50_000_000, [PRESETS[name] for name in names])
    assert clear == snowy == winter
