"""Weather: CARLA's fourteen parameters, its presets, and what follows from them for light and air.

The parameters keep CARLA's names, units and ranges (``PythonAPI/docs/weather.yml``). What they mean
in physical terms is ours, since Unreal's fog density is not an extinction:

* extinction of the fog at height 0: ``0.0375 · (fog_density / 80)^1.5`` 1/m, so that 80 is a
  meteorological optical range (MOR, 5 % contrast) of 80 m and 2 is one of 20 km;
* the fog thins by 1/e every ``10 / fog_falloff`` metres and begins ``fog_distance`` metres away;
* precipitation 100 is rain of 50 mm/h (extinction after the Marshall–Palmer drop sizes);
* the sun's azimuth runs clockwise from east as seen from above.

A weather in one word: a preset and what is changed of it, ``ClearNoon:fog_visibility_m=79``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.errors import ConfigError, unknown_name

MOR_CONTRAST = 0.05
"""Contrast left at the meteorological optical range (ICAO, WMO)."""

WIND_DIRECTION: NDArray[np.float64] = np.array([0.8, -0.6, 0.0])
"""Where the wind always blows to, in the world (east, north, up)."""

_RANGES: dict[str, tuple[float, float]] = {
    "cloudiness": (0.0, 100.0),
    "precipitation": (0.0, 100.0),
    "precipitation_deposits": (0.0, 100.0),
    "wind_intensity": (0.0, 100.0),
    "sun_azimuth_angle": (-360.0, 360.0),
    "sun_altitude_angle": (-90.0, 90.0),
    "fog_density": (0.0, 250.0),  # CARLA ends at 100, a sight of 57 m; 250 is one of 15 m
    "fog_distance": (0.0, 1e6),
    "fog_falloff": (0.0, 1e3),
    "wetness": (0.0, 100.0),
    "scattering_intensity": (0.0, 100.0),
    "mie_scattering_scale": (0.0, 5.0),
    "rayleigh_scattering_scale": (0.0, 2.0),
    "dust_storm": (0.0, 100.0),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class WeatherParameters:
    """The fourteen fields of ``carla.WeatherParameters``; the defaults are CARLA's ClearNoon."""

    cloudiness: float = 5.0
    """Share of the sky covered by clouds [%]."""
    precipitation: float = 0.0
    """Rain intensity [% of 50 mm/h]."""
    precipitation_deposits: float = 0.0
    """Puddles on the road [%]."""
    wind_intensity: float = 10.0
    """Wind strength [%]."""
    sun_azimuth_angle: float = -1.0
    """Direction of the sun, clockwise from east seen from above [deg]."""
    sun_altitude_angle: float = 45.0
    """Height of the sun above the horizon, negative at night [deg]."""
    fog_density: float = 2.0
    """Fog thickness [%]; see `extinction_per_m`."""
    fog_distance: float = 0.75
    """Distance from the camera at which the fog begins [m]."""
    fog_falloff: float = 0.1
    """How fast the fog thins with height; its scale height is 10 / fog_falloff metres."""
    wetness: float = 0.0
    """Wetness of surfaces without puddles [%]."""
    scattering_intensity: float = 1.0
    """Brightness of the light scattered in the air, 1 = physical."""
    mie_scattering_scale: float = 0.03
    """Amount of large particles in the air (haze, pollen); 0.03 is a clean day."""
    rayleigh_scattering_scale: float = 0.0331
    """Amount of air molecules; 0.0331 is the Earth's."""
    dust_storm: float = 0.0
    """Strength of a dust storm [%]."""

    def __post_init__(self) -> None:
        for name, (low, high) in _RANGES.items():
            value = getattr(self, name)
            if not (math.isfinite(value) and low <= value <= high):
                raise ConfigError(f"weather: {name} = {value:g} lies outside {low:g}…{high:g}")

    @classmethod
    def from_mapping(cls, values: Mapping[str, float]) -> WeatherParameters:
        """Weather out of a mapping such as a YAML section; missing fields keep their defaults.

        Raises:
            ConfigError: a key is not one of the fourteen fields, or a value is out of range.
        """
        for key in values:
            if key not in _RANGES:
                raise ConfigError(unknown_name("weather field", key, _RANGES))
        try:
            return cls(**{key: float(value) for key, value in values.items()})
        except (TypeError, ValueError) as error:
            raise ConfigError(f"weather: {error}; give numbers") from error

    def to_mapping(self) -> dict[str, float]:
        """All fourteen fields by name."""
        return {item.name: getattr(self, item.name) for item in fields(self)}

    def at(self, stamp_ns: int) -> WeatherParameters:
        """Weather of a time [ns]: always this one; a `WeatherSchedule` changes."""
        return self

    @property
    def sun_direction(self) -> NDArray[np.float64]:
        """Unit vector towards the sun in the world (east, north, up), shape (3,)."""
        azimuth, altitude = math.radians(self.sun_azimuth_angle), math.radians(self.sun_altitude_angle)
        level = elementary.cos(altitude)
        return np.array(
            [level * elementary.cos(azimuth), -level * elementary.sin(azimuth), elementary.sin(altitude)]
        )

    @property
    def is_night(self) -> bool:
        """Whether lamps and headlamps are lit: the sun stands lower than 2° above the horizon."""
        return self.sun_altitude_angle < 2.0

    @property
    def wind_mps(self) -> NDArray[np.float64]:
        """Velocity of the wind in the world (east, north, up) [m/s], shape (3,); 100 % are 15 m/s.

        It always blows from the north-west.
        """
        return np.asarray(0.15 * self.wind_intensity * WIND_DIRECTION)

    @property
    def rain_mmph(self) -> float:
        """Rain rate [mm/h]."""
        return 0.5 * self.precipitation

    @property
    def fog_extinction_per_m(self) -> float:
        """Extinction by fog at height 0 [1/m]."""
        return float(0.0375 * elementary.power(self.fog_density / 80.0, 1.5))

    @property
    def fog_scale_height_m(self) -> float:
        """Height over which the fog thins by 1/e [m]."""
        return 10.0 / max(self.fog_falloff, 1e-3)

    @property
    def uniform_extinction_per_m(self) -> float:
        """Extinction that does not depend on height: rain, dust and haze [1/m].

        Rain: fit to the Marshall–Palmer sums (0.0010, 0.0016, 0.0028, 0.0043 1/m at 5, 10, 25, 50 mm/h).
        """
        rain = 3.7e-4 * float(elementary.power(self.rain_mmph, 0.63)) if self.precipitation > 0 else 0.0
        haze = 1.0e-4 * self.mie_scattering_scale / 0.03
        return float(rain + haze + 0.03 * self.dust_storm / 100.0)

    @property
    def extinction_per_m(self) -> float:
        """Extinction of the air at height 0 [1/m], one number for cameras and LiDAR."""
        return self.fog_extinction_per_m + self.uniform_extinction_per_m

    @property
    def optical_range_m(self) -> float:
        """Meteorological optical range at height 0 [m]: where 5 % of the contrast is left."""
        return -float(elementary.log(MOR_CONTRAST)) / self.extinction_per_m

    @property
    def surface_wetness(self) -> float:
        """How wet the ground is, 0–1; rain and puddles wet it even when `wetness` is 0."""
        soaked = max(self.wetness, 1.5 * self.precipitation, 1.5 * self.precipitation_deposits)
        return min(soaked / 100.0, 1.0)

    @property
    def overcast(self) -> float:
        """How far clouds, rain, fog or dust hide the sun's disc, 0–1.

        Fog counts through the vertical optical depth that it puts before the sun.
        """
        clouds = min(max((self.cloudiness - 20.0) / 60.0, 0.0), 1.0)
        dust_and_rain = self.uniform_extinction_per_m - 1.0e-4 * self.mie_scattering_scale / 0.03
        depth = self.fog_extinction_per_m * self.fog_scale_height_m + 30.0 * dust_and_rain
        slant = depth / max(elementary.sin(math.radians(max(self.sun_altitude_angle, 5.0))), 0.1)
        return 1.0 - (1.0 - clouds) * float(elementary.exp(-slant))


def _row(*values: float) -> WeatherParameters:
    return WeatherParameters(**dict(zip(_RANGES, values, strict=True)))


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
}
"""All weathers by name: CARLA's presets and the paper's own two, FoggyNoon and RainyNight."""


def weather_by_name(name: str) -> WeatherParameters:
    """One of `PRESETS`; upper and lower case are the same.

    Raises:
        ConfigError: there is no such weather; the message names the nearest one.
    """
    for known, parameters in PRESETS.items():
        if known.lower() == name.lower():
            return parameters
    raise ConfigError(unknown_name("weather", name, PRESETS))


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
