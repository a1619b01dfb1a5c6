"""Clouds of the sky map: how much of the sky they cover, and how bright they are."""

from dataclasses import replace

import numpy as np
import pytest

from carlaloc_env.render.lighting import sky_model
from carlaloc_env.weather.parameters import PRESETS

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
