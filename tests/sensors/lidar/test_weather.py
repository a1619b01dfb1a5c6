"""LiDAR in fog, rain, spray and on wet ground, and its other options, against published curves."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.samples import PointCloud
from carlaloc_env.scene.materials import MATERIALS, Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.lidar.atmosphere import (
    BACKSCATTER_PER_MOR,
    PULSE_S,
    WATER_REFLECTANCE,
    Air,
    DropEcho,
    FogEcho,
    air_at,
    fresnel,
    rain_extinction_per_m,
    wet_reflectance,
)
from carlaloc_env.sensors.lidar.weather_echoes import SolidEchoes, strongest_echoes
from carlaloc_env.weather.parameters import PRESETS, WeatherParameters

pytest.importorskip("open3d", reason="open3d is not installed")
lidar = pytest.importorskip("carlaloc_env.sensors.lidar.lidar")

HEIGHT = 1.85
POWER_MIN = 0.9 / 120.0**2


def model(**changes: Any) -> Any:
    values = {"mount": Mount(position_m=(1.2, 0.0, HEIGHT)), "range_noise_m": 0.0, "weather": True}
    return lidar.LidarConfig(**{**values, **changes})


def fog_of(extinction_per_m: float, **changes: float) -> WeatherParameters:
    """A weather whose extinction at every height is the given one [1/m], haze included."""
    density = 80.0 * ((extinction_per_m - 1e-4) / 0.0375) ** (2 / 3)
    return WeatherParameters(fog_density=density, fog_falloff=0.0, **changes)


def semantic(
    world: Any, drive: Any, config: Any, weather: WeatherParameters, stamp_ns: int = 0
) -> PointCloud:
    world.weather = weather
    cloud = config.build(world).measure(drive, [stamp_ns])[1]
    assert isinstance(cloud, PointCloud)
    return cloud


def ranges(cloud: PointCloud) -> Array:
    return np.linalg.norm(cloud.points_xyz_m.astype(np.float64), axis=-1)


# Air ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["ClearNoon", "FoggyNoon", "HardRainNoon", "RainyNight", "DustStorm"])
def test_extinction_is_the_cameras(name: str) -> None:
    """One number for both at the ground; it thins upwards with the fog's own scale height."""
    weather = PRESETS[name]
    assert air_at(weather, 0.0).extinction_per_m == pytest.approx(weather.extinction_per_m)
    high = air_at(weather, 20.0).extinction_per_m - weather.uniform_extinction_per_m
    expected = weather.fog_extinction_per_m * math.exp(-20 / weather.fog_scale_height_m)
    assert high == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("rain", "published"), [(2.5, 6.5e-4), (10.0, 1.6e-3), (25.0, 2.8e-3), (50.0, 4.3e-3)]
)
def test_rain_extinction_is_marshall_palmers(rain: float, published: float) -> None:
    """LISA's values, and the integral of twice the drops' cross-sections over their distribution."""
    assert rain_extinction_per_m(rain) == pytest.approx(published, rel=0.03)
    slope = 4.1 * rain**-0.21
    integral, _ = quad(lambda d: 2 * math.pi / 4 * d * d * 8000 * math.exp(-slope * d), 0, 20)
    assert rain_extinction_per_m(rain) == pytest.approx(1e-6 * integral, rel=0.05)


@pytest.mark.parametrize(
    ("alpha", "material"),
    [(0.01, Material.PLASTER), (0.03, Material.PLASTER), (0.05, Material.PLASTER), (0.01, Material.RUBBER)],
)
def test_walls_vanish_in_fog_where_theory_says(scenery: Any, alpha: float, material: Material) -> None:
    """ρ·exp(−2αR)/R² = 0.9/R_max²: a wall 4 % nearer is seen face on, one 4 % farther is not."""
    rho = MATERIALS[material].reflectance
    reach = brentq(lambda r: rho * math.exp(-2 * alpha * r) / r**2 - POWER_MIN, 1.0, 120.0)
    for share, seen in ((0.96, True), (1.04, False)):
        x = 1.2 + share * reach
        world = scenery.world([scenery.box([x, -30, -30], [x + 1, 30, 30], material)])
        cloud = semantic(world, scenery.drive(scenery.straight(), 0.2), model(), fog_of(alpha))
        wall = cloud.tag == Tag.BUILDING
        face_on = wall & np.all(np.abs(cloud.points_xyz_m[:, 1:]) < 1.0, axis=-1)
        assert bool(np.any(face_on)) == seen


REACH_IN_FOG = {
    (0.01, 0.1): 30.0, (0.01, 0.9): 64.0, (0.03, 0.1): 21.0, (0.03, 0.9): 38.0, (0.06, 0.1): 16.0,
    (0.06, 0.9): 26.0,
}  # fmt: skip
"""Longest range [m] of dark and bright targets by extinction [1/m] for a sensor of 120 m (LISA's rule)."""


@pytest.mark.parametrize(("alpha", "rho"), sorted(REACH_IN_FOG))
def test_reach_in_fog_is_the_published_curve(alpha: float, rho: float) -> None:
    """The farthest of targets every 10 cm whose echo is seen."""
    at = np.arange(1.0, 120.0, 0.1)
    solid = SolidEchoes(
        range_m=at, power=np.full(len(at), rho), intensity=np.full(len(at), 100 * rho),
        reflectance=np.zeros(len(at)), cos_incidence=np.ones(len(at)),
    )  # fmt: skip
    air = Air(extinction_per_m=alpha, backscatter_per_m_sr=0.0, rain_mmph=0.0, wetness=0.0)
    place, intensity, airborne = strongest_echoes(
        air,
        solid,
        beam_rad=3e-3,
        range_min_m=1.0,
        power_min=POWER_MIN,
        spray_m=None,
        lots=np.ones((len(at), 6)),
    )
    assert not airborne.any()
    assert at[np.isfinite(place)].max() == pytest.approx(REACH_IN_FOG[alpha, rho], abs=0.7)
    assert intensity == pytest.approx(100 * rho * np.exp(-2 * alpha * at), rel=1e-5)


def test_fog_echo_is_rasshofers_integral() -> None:
    """Echo at several distances against numerical integration; its peak lies a few metres away."""
    alpha = 0.05
    air = air_at(fog_of(alpha), 0.0)
    assert air.extinction_per_m == pytest.approx(alpha)
    assert air.backscatter_per_m_sr == pytest.approx(BACKSCATTER_PER_MOR * alpha / math.log(20), rel=1e-6)
    echo = FogEcho(air)
    c = 299_792_458.0

    def exact(at: float) -> float:
        def density(t: float) -> float:
            r = at - 0.5 * c * t
            seen = min(max((r - 0.9) / 0.1, 0.0), 1.0) if r > 0 else 0.0
            return math.sin(math.pi * t / (2 * PULSE_S)) ** 2 * seen * math.exp(-2 * alpha * r) / r**2

        times = np.linspace(0, 2 * PULSE_S, 40_001)
        values = np.array([density(t) for t in times])
        return math.pi * air.backscatter_per_m_sr * float(np.trapezoid(values, times)) * 0.5 * c

    for at in (3.0, 4.5, 8.0, 20.0):
        assert np.interp(at, echo.range_m, echo.power) == pytest.approx(exact(at), rel=0.06)
    peak = echo.range_m[np.argmax(echo.power)]
    assert 2.0 < peak < 6.0
    thin = FogEcho(dataclasses.replace(air, backscatter_per_m_sr=0.5 * air.backscatter_per_m_sr))
    assert thin.power == pytest.approx(0.5 * echo.power)


def test_fog_throws_far_points_near(scenery: Any) -> None:
    """In dense fog most far, dark points turn into a haze near the sensor; clear air has none."""
    wall = scenery.box([25, -60, -30], [26, 60, 40], Material.BRICK_BROWN)
    world, drive = scenery.world([wall]), scenery.drive(scenery.straight(), 0.2)
    share = {}
    for alpha in (1.2e-4, 0.02, 0.05):
        cloud = semantic(world, drive, model(), fog_of(alpha))
        soft = cloud.tag == Tag.UNLABELED
        share[alpha] = np.mean(soft)
        if soft.any():
            assert np.median(ranges(cloud)[soft]) < 8.0
            assert np.all(cloud.instance[soft] == 0)  # type: ignore[index]
            assert cloud.intensity[soft].max() < 60
    assert share[1.2e-4] == 0.0
    assert share[0.05] > share[0.02]
    assert share[0.05] > 0.5


def test_intensity_falls_as_exp_minus_two_alpha_r(scenery: Any) -> None:
    """A bright wall at 20 m in fog against the same wall in clear air."""
    world = scenery.world([scenery.box([21.2, -9, -9], [22, 9, 9], Material.PLASTER)])
    drive = scenery.drive(scenery.straight(), 0.2)
    clear, foggy = (semantic(world, drive, model(), fog_of(alpha)) for alpha in (1.0001e-4, 0.01))
    hard = {}
    for name, cloud in (("clear", clear), ("foggy", foggy)):
        wall = cloud.tag == Tag.BUILDING
        rows = zip(cloud.ring[wall], cloud.offset_ns[wall], cloud.intensity[wall], strict=True)
        hard[name] = {(int(ring), int(offset)): float(value) for ring, offset, value in rows}
    both = hard["clear"].keys() & hard["foggy"].keys()
    assert len(both) > 500
    ratio = np.array([hard["foggy"][k] / hard["clear"][k] for k in both])
    assert np.median(ratio) == pytest.approx(math.exp(-2 * (0.01 - 1e-4) * 20.6), rel=0.03)


# Rain -----------------------------------------------------------------------------------------------


def test_strongest_drop_has_the_distribution_of_simulated_drops() -> None:
    """Drops of Marshall and Palmer scattered into beams one by one, as LISA does, against Λ(p)."""
    air = Air(extinction_per_m=4.3e-3, backscatter_per_m_sr=0.0, rain_mmph=50.0, wetness=1.0)
    beam, near, far = 3e-3, 1.0, 8.0
    echo = DropEcho(air, divergence_rad=beam, range_min_m=near, power_min=POWER_MIN, reach_m=far)
    rng = np.random.default_rng(1)
    slope = 4100.0 * 50.0**-0.21
    cone = math.pi / 3 * math.tan(beam / 2) ** 2
    number = 8e6 / slope * math.exp(-slope * 0.05e-3) * cone * (far**3 - near**3)
    strongest = np.zeros(4000)
    for k in range(len(strongest)):
        count = rng.poisson(number)
        r = (near**3 + rng.random(count) * (far**3 - near**3)) ** (1 / 3)
        size = -np.log(1 - rng.random(count)) / slope + 0.05e-3
        width = 2 * r * math.tan(beam / 2)
        power = WATER_REFLECTANCE * np.exp(-2 * 4.3e-3 * r) / r**2 * np.minimum((size / width) ** 2, 1.0)
        strongest[k] = power.max(initial=0.0)
    drawn, place = echo.draw(1.0 - rng.random((40_000, 2)))
    for p in (0.3 * POWER_MIN, POWER_MIN, 3 * POWER_MIN, 10 * POWER_MIN, 50 * POWER_MIN):
        simulated = np.mean(strongest > p)
        assert np.mean(drawn > p) == pytest.approx(simulated, abs=0.008 + 3 * math.sqrt(simulated / 4000))
    seen = drawn > POWER_MIN
    assert np.all((place[seen] >= near) & (place[seen] <= far))


def test_rain_makes_false_points_near_the_sensor_and_more_of_them_in_hard_rain(scenery: Any) -> None:
    """Into the sky, where nothing else returns: the share of beams is 1 − exp(−Λ(P_min))."""
    world, drive = scenery.world([]), scenery.drive(scenery.straight(), 0.2)
    config = model(range_min_m=1.0)
    shares = []
    for precipitation in (10.0, 50.0, 100.0):
        weather = WeatherParameters(precipitation=precipitation, fog_density=0.0, mie_scattering_scale=0.0)
        cloud = semantic(world, drive, config, weather)
        air = air_at(weather, HEIGHT)
        echo = DropEcho(air, divergence_rad=3e-3, range_min_m=1.0, power_min=POWER_MIN)
        mean = float(np.interp(math.log(POWER_MIN), np.log(echo.power), echo.expected))
        expected = 1 - math.exp(-mean)
        found = len(cloud.points_xyz_m) / config.rays
        assert found == pytest.approx(expected, rel=0.1, abs=5e-4)
        assert cloud.tag is not None
        assert set(cloud.tag.tolist()) <= {0}
        shares.append(found)
    assert shares[0] < shares[1] < shares[2]
    assert 0.0 < shares[2] < 0.5


def test_wet_ground_is_dark_ahead_and_gone_at_grazing_angles(scenery: Any) -> None:
    """Asphalt keeps 0.3–0.6 of its return near normal; far ground vanishes sooner than when dry."""
    rho = np.array([0.15, 0.2])
    steep = wet_reflectance(rho, np.array([1.0, 0.9]), 1.0) / rho
    assert np.all((steep > 0.3) & (steep < 0.62))
    assert wet_reflectance(rho, np.array([0.02, 0.02]), 1.0).max() < 0.01
    assert np.array_equal(wet_reflectance(rho, np.array([0.5, 0.5]), 0.0), rho)
    world, drive = scenery.world([scenery.ground()]), scenery.drive(scenery.straight(), 0.2)
    dry, wet = (
        ranges(semantic(world, drive, model(), WeatherParameters(wetness=w, fog_density=0.0)))
        for w in (0.0, 100.0)
    )
    assert wet.max() < 0.8 * dry.max()


def test_fresnel() -> None:
    """Water: 2 % face on, Brewster's angle without the one polarisation, all at grazing incidence."""
    brewster = math.atan(1.33)
    values = fresnel(np.cos([0.0, brewster, math.pi / 2]), 1.33)
    assert values[0] == pytest.approx((0.33 / 2.33) ** 2)
    s = (math.cos(brewster) - 1.33 * math.sqrt(1 - (math.sin(brewster) / 1.33) ** 2)) / (
        math.cos(brewster) + 1.33 * math.sqrt(1 - (math.sin(brewster) / 1.33) ** 2)
    )
    assert values[1] == pytest.approx(0.5 * s * s, abs=1e-9)
    assert values[2] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("wetness", "speed", "some"), [(100.0, 25.0, True), (0.0, 25.0, False), (100.0, 4.0, False)]
)
def test_spray_hangs_behind_fast_cars_on_wet_roads(
    scenery: Any, wetness: float, speed: float, some: bool
) -> None:
    """Untagged points between the car ahead and the sensor, inside the plume, and only there."""
    models = {"saloon": scenery.box([-2.3, -0.9, 0.1], [2.3, 0.9, 1.4])}
    catalog = dataclasses.replace(scenery.catalog(["saloon"]), size_m=np.array([[4.6, 1.8, 1.4]], np.float32))
    drive = scenery.drive(
        scenery.straight(), 0.3, catalog, lambda t: scenery.frame([[25 + speed * t, 0, 0]], [0.0], speed)
    )
    weather = WeatherParameters(wetness=wetness, fog_density=0.0, mie_scattering_scale=0.0)
    cloud = semantic(scenery.world([scenery.ground()], models), drive, model(), weather, 100_000_000)
    spray = cloud.points_xyz_m[cloud.tag == Tag.UNLABELED] + [1.2, 0, HEIGHT]
    assert (len(spray) > 20) == some
    if some:
        middle = 25 + speed * 0.125
        assert spray[:, 0].min() > middle - 2.3 - 13
        assert spray[:, 0].max() < middle - 2.2
        assert np.abs(spray[:, 1]).max() < 1.25
        assert spray[:, 2].max() < 1.85


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


# Other options --------------------------------------------------------------------------------------


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


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"sectors": -1}, "sectors"),
        ({"dropoff_general": 1.5}, "drop-off"),
        ({"dropoff_intensity_limit": 0.0}, "drop-off"),
        ({"divergence_mrad": -1.0}, "divergence"),
    ],
)
def test_wrong_options_are_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        model(**wrong)
