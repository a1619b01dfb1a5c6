"""Presets of the weather by name, and weathers in one word: ``ClearNoon:fog_visibility_m=79``."""

from __future__ import annotations

from carlaloc_env.core import elementary
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.weather.parameters import MOR_CONTRAST, RANGES, WeatherParameters

PHYSICAL = ("fog_visibility_m", "rain_mmph")
"""Quantities beside the fields: meteorological optical range at the ground, rain rate."""


def _row(*values: float) -> WeatherParameters:
    return WeatherParameters(**dict(zip(RANGES, values, strict=False)))


PRESETS: dict[str, WeatherParameters] = {
    # Values of carla.WeatherParameters 0.9.16, in the order of its fields.
    "ClearNoon": _row(5, 0, 0, 10, -1, 45, 2, 0.75, 0.1, 0, 1, 0.03, 0.0331, 0),
    "CloudyNoon": _row(60, 0, 0, 10, -1, 45, 3, 0.75, 0.1, 0, 1, 0.03, 0.0331, 0),
    "WetNoon": _row(5, 0, 50, 10, -1, 45, 3, 0.75, 0.1, 0, 1, 0.03, 0.0331, 0),
    "WetCloudyNoon": _row(60, 0, 50, 10, -1, 45, 3, 0.75, 0.1, 0, 1, 0.03, 0.0331, 0),
    "SoftRainNoon": _row(20, 30, 50, 30, -1, 45, 3, 0.75, 0.1, 0, 1, 0.03, 0.0331, 0),
    "MidRainyNoon": _row(60, 60, 60, 60, -1, 45, 3, 0.75, 0.1, 0, 1, 0.03, 0.0331, 0),
    "HardRainNoon": _row(100, 100, 90, 100, -1, 45, 7, 0.75, 0.1, 0, 1, 0.03, 0.0331, 0),
    "ClearSunset": _row(5, 0, 0, 10, -1, 15, 2, 0.75, 0.1, 0, 1, 0.03, 0.0331, 0),
    "CloudySunset": _row(60, 0, 0, 10, -1, 15, 3, 0.75, 0.1, 0, 1, 0.03, 0.0331, 0),
    "WetSunset": _row(5, 0, 50, 10, -1, 15, 2, 0.75, 0.1, 0, 1, 0.03, 0.0331, 0),
    "WetCloudySunset": _row(60, 0, 50, 10, -1, 15, 2, 0.75, 0.1, 0, 1, 0.03, 0.0331, 0),
    "SoftRainSunset": _row(20, 30, 50, 30, -1, 15, 2, 0.75, 0.1, 0, 1, 0.03, 0.0331, 0),
    "MidRainSunset": _row(60, 60, 60, 60, -1, 15, 3, 0.75, 0.1, 0, 1, 0.03, 0.0331, 0),
    "HardRainSunset": _row(100, 100, 90, 100, -1, 15, 7, 0.75, 0.1, 0, 1, 0.03, 0.0331, 0),
    "ClearNight": _row(5, 0, 0, 10, -1, -90, 60, 75, 1, 0, 1, 0.03, 0.0331, 0),
    "CloudyNight": _row(60, 0, 0, 10, -1, -90, 60, 0.75, 0.1, 0, 1, 0.03, 0.0331, 0),
    "WetNight": _row(5, 0, 50, 10, -1, -90, 60, 75, 1, 60, 1, 0.03, 0.0331, 0),
    "WetCloudyNight": _row(60, 0, 50, 10, -1, -90, 60, 0.75, 0.1, 60, 1, 0.03, 0.0331, 0),
    "SoftRainNight": _row(60, 30, 50, 30, -1, -90, 60, 0.75, 0.1, 60, 1, 0.03, 0.0331, 0),
    "MidRainyNight": _row(80, 60, 60, 60, -1, -90, 60, 0.75, 0.1, 80, 1, 0.03, 0.0331, 0),
    "HardRainNight": _row(100, 100, 90, 100, -1, -90, 100, 0.75, 0.1, 100, 1, 0.03, 0.0331, 0),
    "DustStorm": _row(100, 0, 0, 100, -1, 45, 2, 0.75, 0.1, 0, 1, 0.03, 0.0331, 100),
    # CARLA's Default leaves every value to the map; ours is its ClearNoon.
    "Default": _row(5, 0, 0, 10, -1, 45, 2, 0.75, 0.1, 0, 1, 0.03, 0.0331, 0),
    # Ours: the paper names these two and prints no values. FoggyNoon is a MOR of 79 m at the ground.
    "FoggyNoon": _row(60, 0, 0, 10, -1, 45, 80, 0, 0.05, 0, 1, 0.03, 0.0331, 0),
    "RainyNight": _row(90, 60, 60, 40, -1, -90, 14, 0, 0.05, 80, 1, 0.03, 0.0331, 0),
    # Ours: winter. Snow of 1 mm/h is the upper end of light snowfall; 12° is the sun at noon in December at
    # 54° north.
    "SnowyNoon": _row(100, 0, 0, 20, -1, 20, 2, 0.75, 0.1, 0, 1, 0.03, 0.0331, 0, 1, 1),
    "SnowyNight": _row(100, 0, 0, 20, -1, -90, 2, 0.75, 0.1, 0, 1, 0.03, 0.0331, 0, 1, 1),
    "WinterNoon": _row(15, 0, 0, 10, -1, 12, 2, 0.75, 0.1, 0, 1, 0.03, 0.0331, 0, 0, 1),
}
"""All weathers by name: CARLA's presets, the paper's FoggyNoon and RainyNight, and three of winter."""


def weather_by_name(name: str) -> WeatherParameters:
    """One of `PRESETS`; upper and lower case are the same.

    Raises:
        ConfigError: there is no such weather; the message names the nearest one.
    """
    for preset, parameters in PRESETS.items():
        if preset.lower() == name.lower():
            return parameters
    raise ConfigError(unknown_name("weather", name, PRESETS))


def changed_weather(text: str) -> WeatherParameters:
    """Weather of a preset's name with changes behind it, each ``:NAME=NUMBER``.

    Raises:
        ConfigError: there is no such preset or field, or a value is no number in its range.
    """
    name, *changes = text.split(":")
    weather = weather_by_name(name)
    for change in changes:
        key, given, value = change.partition("=")
        try:
            number = float(value)
        except ValueError:
            given = ""
        if not given:
            raise ConfigError(f"weather '{text}': give changes as NAME=NUMBER, e.g. {name}:fog_density=40")
        weather = with_quantity(weather, key, number)
    return weather


def weather_quantities() -> tuple[str, ...]:
    """Names of all that can be changed of a weather."""
    return (*RANGES, *PHYSICAL)


def with_quantity(weather: WeatherParameters, name: str, value: float) -> WeatherParameters:
    """The weather with another value of a field or of a physical quantity.

    Raises:
        ConfigError: there is no such quantity, or no weather has this value of it.
    """
    fields = weather.to_mapping()
    if name == "fog_visibility_m":
        # The inverse of `fog_extinction_per_m`, with the air's own extinction in it.
        wanted = -float(elementary.log(MOR_CONTRAST)) / max(value, 1e-9) - weather.uniform_extinction_per_m
        fields["fog_density"] = 80.0 * float(elementary.power(max(wanted, 0.0) / 0.0375, 2.0 / 3.0))
    elif name == "rain_mmph":
        fields["precipitation"] = 2.0 * value
    elif name in RANGES:
        fields[name] = value
    else:
        raise ConfigError(unknown_name("weather quantity", name, weather_quantities()))
    try:
        return WeatherParameters.from_mapping(fields)
    except ConfigError as error:
        raise ConfigError(f"{name} = {value:g}: {error}") from error


def weather_word(text: str) -> str:
    """A name for folders of a weather as users write it."""
    name = text.rpartition("/")[2]
    for suffix in (".yaml", ".yml"):
        name = name.removesuffix(suffix)
    return name.replace(":", "_").replace("=", "-").replace("+", "")
