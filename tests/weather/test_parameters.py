"""Weather parameters: CARLA's values, ranges, and the physics derived from them."""

import math

import numpy as np
import pytest

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.render.lighting import sky_model
from carlaloc_env.render.lighting.sky_model import hemisphere, sky_light
from carlaloc_env.weather.parameters import WeatherParameters
from carlaloc_env.weather.presets import PRESETS, weather_by_name


@pytest.mark.long
def test_presets_are_those_of_the_carla_package() -> None:
    carla = pytest.importorskip("carla", reason="the carla client wheel is a dev extra")
    names = [
        name
        for name in dir(carla.WeatherParameters)
        if isinstance(getattr(carla.WeatherParameters, name), carla.WeatherParameters) and name != "Default"
    ]
    assert len(names) >= 22
    for name in names:
        theirs = getattr(carla.WeatherParameters, name)
        for key, value in PRESETS[name].to_mapping().items():
            assert value == pytest.approx(getattr(theirs, key), abs=1e-5), (name, key)


def test_names_ignore_case() -> None:
    assert weather_by_name("rainynight") is PRESETS["RainyNight"]


@pytest.mark.parametrize(
    ("field", "value"),
    [("fog_density", 251.0), ("sun_altitude_angle", -91.0), ("wetness", math.nan), ("fog_distance", -1.0)],
)
def test_values_out_of_range_are_refused(field: str, value: float) -> None:
    with pytest.raises(ConfigError, match=field):
        WeatherParameters(**{field: value})


def test_mapping_round_trip() -> None:
    weather = PRESETS["HardRainSunset"]
    assert WeatherParameters.from_mapping(weather.to_mapping()) == weather


def test_foggy_noon_has_the_documented_optical_range() -> None:
    assert 60.0 <= PRESETS["FoggyNoon"].optical_range_m <= 100.0
    assert PRESETS["ClearNoon"].optical_range_m > 10_000.0


def test_optical_range_leaves_five_percent() -> None:
    weather = PRESETS["FoggyNoon"]
    assert math.exp(-weather.extinction_per_m * weather.optical_range_m) == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("rain_mmph", "extinction_per_m"), [(5, 0.0010), (10, 0.0016), (25, 0.0028), (50, 0.0043)]
)
def test_rain_extinction_follows_marshall_palmer(rain_mmph: float, extinction_per_m: float) -> None:
    wet = WeatherParameters(precipitation=2.0 * rain_mmph)
    dry = WeatherParameters()
    assert wet.extinction_per_m - dry.extinction_per_m == pytest.approx(extinction_per_m, rel=0.05)


def test_sun_stands_where_the_angles_say() -> None:
    sun = WeatherParameters(sun_azimuth_angle=90.0, sun_altitude_angle=30.0).sun_direction
    np.testing.assert_allclose(sun, [0.0, -math.cos(math.pi / 6), 0.5], atol=1e-12)


def test_sky_map_covers_the_half_sphere_evenly() -> None:
    """Integrals of 1, cos and cos² over the half-sphere are 2π, π and 2π/3."""
    directions, solid_angle_sr = hemisphere()
    up = directions[..., 2]
    assert float(solid_angle_sr.sum()) == pytest.approx(2 * math.pi)
    assert float((solid_angle_sr * up).sum()) == pytest.approx(math.pi, rel=1e-4)
    assert float((solid_angle_sr * up**2).sum()) == pytest.approx(2 * math.pi / 3, rel=1e-4)


@pytest.mark.parametrize(
    ("name", "low_lx", "high_lx"),
    [
        ("ClearNoon", 60e3, 95e3),
        ("FoggyNoon", 10e3, 30e3),
        ("ClearSunset", 8e3, 35e3),
        ("RainyNight", 0.1, 10),
    ],
)
def test_illuminance_is_of_the_right_order(name: str, low_lx: float, high_lx: float) -> None:
    """Sun and sky on a level surface, against handbook values."""
    light = sky_light(PRESETS[name])
    directions, solid_angle_sr = hemisphere()
    sky_lx = np.sum(light.sky_cd_m2 * (directions[..., 2] * solid_angle_sr)[..., None], axis=(0, 1))
    total = (sky_lx + light.sun_lx * max(light.sun_direction[2], 0.0)) @ np.array([0.2126, 0.7152, 0.0722])
    assert low_lx < total < high_lx


def test_every_preset_gives_finite_light(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sky_model, "SKY_SIZE_PX", 64)
    for name, weather in PRESETS.items():
        light = sky_light.__wrapped__(weather)
        for part in (light.sky_cd_m2, light.sun_lx, light.irradiance, light.fog_cd_m2):
            assert np.isfinite(part).all(), name
        assert light.sky_cd_m2.min() >= 0.0, name
