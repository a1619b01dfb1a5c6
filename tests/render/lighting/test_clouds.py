"""Clouds of the sky map: how much of the sky they cover, and how bright they are."""

from dataclasses import replace

import numpy as np
import pytest

from carlaloc_env.render.lighting import sky_model
from carlaloc_env.weather.presets import PRESETS

NOON = replace(PRESETS["ClearNoon"], fog_density=0.0)


@pytest.mark.parametrize("cloudiness", [5.0, 20.0, 40.0, 60.0, 80.0])
def test_as_much_of_the_sky_is_cloudy_as_the_weather_says(cloudiness: float) -> None:
    """Share of the sky's solid angle, seen in the picture itself, without the haze along the horizon."""
    weather = replace(NOON, cloudiness=cloudiness)
    directions, solid_angle_sr = sky_model.hemisphere()
    density = sky_model._clouds(cloudiness / 100.0, directions)
    share = solid_angle_sr[density > 0.5].sum() / solid_angle_sr.sum()
    # The lowest 8.6 degrees of the sky are 15 % of it, and lie half in haze.
    assert 0.85 * cloudiness / 100.0 <= share <= 1.02 * cloudiness / 100.0
    if weather.overcast == 0.0:
        clear = sky_model._preetham(weather, directions)
        sky = sky_model.sky_light(weather).sky_cd_m2
        changed = np.abs(sky - clear).max(axis=2) > 0.25 * clear.max(axis=2)
        assert solid_angle_sr[changed].sum() / solid_angle_sr.sum() <= 1.3 * cloudiness / 100.0
        assert (sky.sum(axis=2) >= 0.99 * clear.sum(axis=2))[density > 0.5].all()


def test_a_sky_without_clouds_is_the_clear_one() -> None:
    directions, _ = sky_model.hemisphere()
    weather = replace(NOON, cloudiness=0.0)
    np.testing.assert_array_equal(
        sky_model.sky_light(weather).sky_cd_m2, sky_model._preetham(weather, directions)
    )


def test_clouds_are_white_where_the_sky_is_blue() -> None:
    weather = replace(NOON, cloudiness=20.0)
    directions, _ = sky_model.hemisphere()
    sky = sky_model.sky_light(weather).sky_cd_m2
    inside = sky_model._clouds(0.2, directions) > 0.9
    blue = (sky[..., 2] / sky[..., 0])[directions[..., 2] > 0.3]
    assert np.median(sky[inside][:, 2] / sky[inside][:, 0]) < 1.12
    assert np.median(blue) > 1.3


def test_the_sun_is_as_wide_and_bright_as_buie_s_sunshape_until_it_is_cut() -> None:
    """Within the disc all is cut; 30 mrad off, the aureole is e^κ·θ^γ of it; clouds hide both."""
    weather = replace(NOON, cloudiness=0.0, sun_altitude_angle=40.0)
    directions, _ = sky_model.hemisphere()
    light = sky_model.sky_light(weather)
    away_mrad = 1e3 * np.arccos(np.clip(np.sum(directions * light.sun_direction, axis=-1), -1.0, 1.0))
    disc_cd_m2 = light.sun_lx / (np.pi * (1e-3 * sky_model.SUN_MRAD) ** 2)
    chi = sky_model.CIRCUMSOLAR
    kappa = 0.9 * np.log(13.5 * chi) * chi**-0.3
    gamma = 2.2 * np.log(0.52 * chi) * chi**0.43 - 0.1
    assert np.all(light.sun_cd_m2[away_mrad < sky_model.SUN_MRAD] == sky_model.SUN_MOST_CD_M2)
    ring = (away_mrad > 30.0) & (away_mrad < 43.0)
    expected = np.exp(kappa) * away_mrad[ring, None] ** gamma * disc_cd_m2
    assert light.sun_cd_m2[ring] == pytest.approx(np.minimum(expected, sky_model.SUN_MOST_CD_M2))
    assert not light.sun_cd_m2[away_mrad > sky_model.AUREOLE_MRAD].any()
    # The cut luminance saturates a picture, which bends towards white above 0.6.
    assert light.exposure * sky_model.SUN_MOST_CD_M2 > 3.0
    assert not sky_model.sky_light(replace(weather, cloudiness=100.0)).sun_cd_m2.any()
