"""LiDAR in fog, rain, spray and on wet ground, and its other options, against published curves."""

import math
from typing import Any

import numpy as np
import pytest
from shared_fixtures.readings.lidar_weather import HEIGHT, model, ranges, semantic

from carlaloc_env.scene.materials import Material
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.lidar.atmosphere import atmosphere_at
from carlaloc_env.weather.presets import PRESETS

pytest.importorskip("open3d", reason="open3d is not installed")

lidar = pytest.importorskip("carlaloc_env.sensors.lidar.lidar")


@pytest.mark.parametrize("name", ["ClearNoon", "FoggyNoon", "HardRainNoon", "RainyNight", "DustStorm"])
def test_extinction_is_the_cameras(name: str) -> None:
    """One number for both at the ground; it thins upwards with the fog's own scale height."""
    weather = PRESETS[name]
    assert atmosphere_at(weather, 0.0).extinction_per_m == pytest.approx(weather.extinction_per_m)
    high = atmosphere_at(weather, 20.0).extinction_per_m - weather.uniform_extinction_per_m
    expected = weather.fog_extinction_per_m * math.exp(-20 / weather.fog_scale_height_m)
    assert high == pytest.approx(expected, abs=1e-9)


def test_weather_is_off_in_the_papers_rig_and_shared_casts_agree(scenery: Any) -> None:
    """Off: the same bytes in any weather. On: several weathers at once equal one at a time."""
    world = scenery.world([scenery.ground(), scenery.box([20, -9, 0], [22, 9, 9])])
    drive = scenery.drive(scenery.weaving, 0.3)
    dry, foul = PRESETS["ClearNoon"], PRESETS["HardRainNoon"]
    off = lidar.LidarConfig(mount=Mount(position_m=(1.2, 0, HEIGHT))).build(world)
    assert off.depends_on_weather is False
    a, b = off.measure_conditions(drive, 50_000_000, [dry, foul])
    assert a == b
    on = model(range_noise_m=0.02).build(world)
    both = on.measure_conditions(drive, 50_000_000, [dry, foul])
    for weather, clouds in zip((dry, foul), both, strict=True):
        world.weather = weather
        assert on.measure(drive, [50_000_000]) == clouds
    assert both[0] != both[1]


def test_ten_sectors_stand_still_in_time(scenery: Any) -> None:
    """As CARLA at 200 Hz: ten times per sweep; at 20 m/s points are off by a uniform 0–0.1 m, rms 0.029."""
    world = scenery.world([scenery.box([40, -200, -60], [41, 200, 60])])
    drive = scenery.drive(scenery.straight(20.0), 0.3)
    held = semantic(world, drive, model(weather=False, sectors=10), PRESETS["ClearNoon"], 100_000_000)
    smooth = semantic(world, drive, model(weather=False), PRESETS["ClearNoon"], 100_000_000)
    assert sorted(set(held.offset_ns.tolist())) == [
        k * 5_000_000 for k in range(10) if np.any(held.offset_ns == k * 5_000_000)
    ]
    assert np.all(np.diff(held.offset_ns.astype(np.int64)) >= 0)
    times = held.stamp_ns + held.offset_ns.astype(np.int64)
    x = held.points_xyz_m[:, 0] + 1.2 + 20.0 * times * 1e-9
    assert np.abs(x - 40.0).max() < 2e-3, "exact for the instant of its own sector"
    key = {(int(r), round(math.atan2(p[1], p[0]), 5)): p[0] for r, p in
           zip(smooth.ring, smooth.points_xyz_m.astype(float), strict=True)}  # fmt: skip
    off = [p[0] - key[k] for r, p in zip(held.ring, held.points_xyz_m.astype(float), strict=True)
           if (k := (int(r), round(math.atan2(p[1], p[0]), 5))) in key]  # fmt: skip
    assert len(off) > 1000
    assert np.std(off) == pytest.approx(0.1 / math.sqrt(12), rel=0.1)


def test_drop_off_is_carlas(scenery: Any) -> None:
    """45 % lost at random, and of weak points the share 0.4·(1 − I/0.8) besides, I = exp(−0.004 R)."""
    world = scenery.world([scenery.box([101.2, -300, -200], [102, 300, 200])])
    drive = scenery.drive(scenery.straight(), 0.2)
    full = semantic(world, drive, model(weather=False), PRESETS["ClearNoon"])
    config = model(weather=False, dropoff_general=0.45, dropoff_zero_intensity=0.4)
    thin = semantic(world, drive, config, PRESETS["ClearNoon"])
    weak = np.exp(-0.004 * ranges(full))
    stays = np.where(weak > 0.8, 1.0, 0.5 * weak + 0.6)
    expected = 0.55 * stays.sum()
    assert len(thin.points_xyz_m) == pytest.approx(expected, abs=4 * math.sqrt(expected))
    whole = {p.tobytes() for p in full.points_xyz_m}
    assert all(p.tobytes() in whole for p in thin.points_xyz_m), "dropped, not moved"


def test_a_wide_beam_mixes_at_edges_and_nowhere_else(scenery: Any) -> None:
    """A post 0.4 m before a wall: points between the two at its edges only; the bare wall stays flat."""
    wall = scenery.box([20, -60, -40], [21, 60, 40], Material.PLASTER)
    post = scenery.box([19.6, -1.2, -30], [19.65, 1.2, 30], Material.PLASTER)
    drive = scenery.drive(scenery.straight(), 0.2)
    config = model(weather=False, divergence_mrad=6.0)
    bare = semantic(scenery.world([wall]), drive, config, PRESETS["ClearNoon"])
    front = np.abs(bare.points_xyz_m[:, 1]) < 10
    assert np.abs(bare.points_xyz_m[front, 0] + 1.2 - 20).max() < 0.02
    mixed = semantic(scenery.world([wall, post]), drive, config, PRESETS["ClearNoon"])
    x, y = mixed.points_xyz_m[:, 0] + 1.2, mixed.points_xyz_m[:, 1]
    between = (x > 19.65) & (x < 19.95) & (np.abs(y) < 10)
    assert np.count_nonzero(between) > 10
    edge = np.minimum(np.abs(np.abs(y) - 1.2), np.abs(np.abs(y * 20 / 19.6) - 1.2))
    assert edge[between].max() < 0.15
    sharp = semantic(scenery.world([wall, post]), drive, model(weather=False), PRESETS["ClearNoon"])
    sx = sharp.points_xyz_m[:, 0] + 1.2
    assert not np.any((sx > 19.66) & (sx < 19.95) & (np.abs(sharp.points_xyz_m[:, 1]) < 10))
