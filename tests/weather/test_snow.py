"""Snow: flakes against published laws, what mappings hold, and what does not fall together."""

import math

import pytest
from scipy.integrate import quad

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.weather.parameters import WeatherParameters
from carlaloc_env.weather.presets import PRESETS, changed_weather
from carlaloc_env.weather.schedule import WeatherSchedule
from carlaloc_env.weather.snowfall import extinction_per_m, fall_mps, flakes_per_m3

RATES = (0.1, 0.5, 1.0, 2.5, 5.0)


@pytest.mark.parametrize("snowfall", RATES)
def test_extinction_is_twice_the_cross_section_of_all_flakes(snowfall: float) -> None:
    """Gunn and Marshall's sizes of melted flakes, swollen to a density of 0.1 g/cm³."""
    swollen, slope = 10.0 ** (1 / 3), 2.55 * snowfall**-0.48
    area_mm2, _ = quad(lambda d: (d * swollen) ** 2 * 3.8e3 * snowfall**-0.87 * math.exp(-slope * d), 0, 60)
    assert extinction_per_m(snowfall) == pytest.approx(2 * math.pi / 4 * 1e-6 * area_mm2, rel=1e-6)


@pytest.mark.parametrize("snowfall", RATES)
def test_sight_is_within_three_times_rasmussens(snowfall: float) -> None:
    """Dry snow: 0.80 km / S at 2 % of contrast, 0.766 of that at 5 %."""
    weather = WeatherParameters(snowfall=snowfall, fog_density=0.0, mie_scattering_scale=0.0)
    ratio = weather.optical_range_m / (0.766 * 800.0 / snowfall)
    assert 1 / 3 < ratio < 3


@pytest.mark.parametrize("snowfall", [0.5, 1.0, 2.5])
def test_flakes_bring_the_water_of_their_rate(snowfall: float) -> None:
    """Volume · 0.1 g/cm³ · speed, though sizes and speeds were measured by different people."""
    width = 0.05
    mmph = sum(
        flakes_per_m3(snowfall, d, width) * math.pi / 6 * (d * 1e-3) ** 3 * 0.1 * fall_mps(d) * 3.6e6
        for d in (width * (k + 0.5) for k in range(800))
    )
    assert mmph == pytest.approx(snowfall, rel=0.25)


def test_mappings_of_weathers_without_snow_are_carlas() -> None:
    for name, weather in PRESETS.items():
        snowy = name in ("SnowyNoon", "SnowyNight", "WinterNoon")
        assert ("snow_cover" in weather.to_mapping()) == snowy
        assert WeatherParameters.from_mapping(weather.to_mapping()) == weather
    assert len(PRESETS["ClearNoon"].to_mapping()) == 14
    assert changed_weather("SnowyNoon:snowfall=2.5").snowfall == 2.5


def test_rain_and_snow_do_not_fall_together() -> None:
    with pytest.raises(ConfigError, match="rain and snow"):
        WeatherParameters(precipitation=1.0, snowfall=1.0)
    with pytest.raises(ConfigError, match="rain turns into snow"):
        WeatherSchedule(at_s=(0.0, 9.0), weathers=(PRESETS["HardRainNoon"], PRESETS["SnowyNoon"]))


def test_snow_begins_in_a_schedule() -> None:
    schedule = WeatherSchedule(at_s=(0.0, 10.0), weathers=(PRESETS["ClearNoon"], PRESETS["SnowyNoon"]))
    now = schedule.at(5_000_000_000)
    assert (now.snowfall, now.snow_cover, now.cloudiness) == (0.5, 0.5, 52.5)
