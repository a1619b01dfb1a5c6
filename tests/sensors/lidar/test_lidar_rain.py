"""Rain in LiDAR scans: drops, wet ground and spray against theory."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from shared_fixtures.readings.lidar_weather import HEIGHT, POWER_MIN, model, ranges, semantic

from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.lidar.atmosphere import (
    WATER_REFLECTANCE,
    Atmosphere,
    DropEcho,
    atmosphere_at,
    fresnel,
    rain_extinction_per_m,
    wet_reflectance,
)
from carlaloc_env.weather.parameters import WeatherParameters

pytest.importorskip("open3d", reason="open3d is not installed")

lidar = pytest.importorskip("carlaloc_env.sensors.lidar.lidar")


@pytest.mark.parametrize(
    ("rain", "published"), [(2.5, 6.5e-4), (10.0, 1.6e-3), (25.0, 2.8e-3), (50.0, 4.3e-3)]
)
def test_rain_extinction_is_marshall_palmers(rain: float, published: float) -> None:
    """LISA's values, and the integral of twice the drops' cross-sections over their distribution."""
    assert rain_extinction_per_m(rain) == pytest.approx(published, rel=0.03)
    slope = 4.1 * rain**-0.21
    integral, _ = quad(lambda d: 2 * math.pi / 4 * d * d * 8000 * math.exp(-slope * d), 0, 20)
    assert rain_extinction_per_m(rain) == pytest.approx(1e-6 * integral, rel=0.05)


def test_strongest_drop_has_the_distribution_of_simulated_drops() -> None:
    """Drops of Marshall and Palmer scattered into beams one by one, as LISA does, against Λ(p)."""
    air = Atmosphere(extinction_per_m=4.3e-3, backscatter_per_m_sr=0.0, rain_mmph=50.0, wetness=1.0)
    beam, near, far = 3e-3, 1.0, 8.0
    echo = DropEcho(air, divergence_rad=beam, range_min_m=near, power_min=POWER_MIN, range_limit_m=far)
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
    drawn, place = echo.draw(1.0 - rng.random((40_000, 2)), np.zeros(40_000))
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
        air = atmosphere_at(weather, HEIGHT)
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
