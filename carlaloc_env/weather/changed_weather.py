"""A weather in one word: a preset and what is changed of it, ``ClearNoon:fog_visibility_m=79``."""

from __future__ import annotations

from carlaloc_env.core import elementary
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.weather.parameters import MOR_CONTRAST, WeatherParameters, weather_by_name

PHYSICAL = ("fog_visibility_m", "rain_mmph")
"""Quantities beside the fourteen fields: meteorological optical range at the ground, rain rate."""


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
    return (*WeatherParameters().to_mapping(), *PHYSICAL)


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
    elif name in fields:
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
