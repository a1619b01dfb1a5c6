"""Weather in CARLA's fourteen parameters and two of snow, and the light and air that follow from them.

CARLA's parameters keep its names, units and ranges (``PythonAPI/docs/weather.yml``); snow is ours.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.weather.snowfall import extinction_per_m as snow_extinction_per_m

MOR_CONTRAST = 0.05
"""Contrast left at the meteorological optical range (ICAO, WMO)."""
WIND_DIRECTION: NDArray[np.float64] = np.array([0.8, -0.6, 0.0])
"""Where the wind always blows to, in the world (east, north, up)."""
RANGES: dict[str, tuple[float, float]] = {
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
    "snowfall": (0.0, 10.0),
    "snow_cover": (0.0, 1.0),
}
SNOW = ("snowfall", "snow_cover")
"""Fields that are ours; mappings name them only where there is snow, so that others stay as they were."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WeatherParameters:
    """The fourteen fields of ``carla.WeatherParameters`` and two of snow; the defaults are CARLA's ClearNoon.

    Their physical meaning is ours, since Unreal's fog density is not an extinction:

    * extinction of the fog at height 0: ``0.0375 · (fog_density / 80)^1.5`` 1/m. So 80 is a
      meteorological optical range (MOR, 5 % contrast) of 80 m, and 2 is one of 20 km;
    * the fog thins by 1/e every ``10 / fog_falloff`` metres and begins ``fog_distance`` metres away;
    * precipitation 100 is rain of 50 mm/h (extinction after the Marshall–Palmer drop sizes);
    * snow falls as water of so many mm/h in flakes of 0.1 g/cm³ (`weather.snowfall`), never with rain;
    * the sun's azimuth runs clockwise from east as seen from above.
    """

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
    snowfall: float = 0.0
    """Rate of falling snow [mm/h of water]."""
    snow_cover: float = 0.0
    """Share of open level surfaces under snow, 0–1 [1]."""

    def __post_init__(self) -> None:
        for name, (low, high) in RANGES.items():
            value = getattr(self, name)
            if not (math.isfinite(value) and low <= value <= high):
                raise ConfigError(f"weather: {name} = {value:g} lies outside {low:g}…{high:g}")
        if self.precipitation > 0.0 and self.snowfall > 0.0:
            raise ConfigError("weather: rain and snow fall together; set precipitation or snowfall to 0")

    @classmethod
    def from_mapping(cls, values: Mapping[str, float]) -> WeatherParameters:
        """Weather out of a mapping such as a YAML section; missing fields keep their defaults.

        Raises:
            ConfigError: a key is not a field, or a value is out of range.
        """
        for key in values:
            if key not in RANGES:
                raise ConfigError(unknown_name("weather field", key, RANGES))
        try:
            return cls(**{key: float(value) for key, value in values.items()})
        except (TypeError, ValueError) as error:
            raise ConfigError(f"weather: {error}; give numbers") from error

    def to_mapping(self) -> dict[str, float]:
        """All fields by name, those of snow where they are above 0."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        return {name: value for name, value in values.items() if value or name not in SNOW}

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
    def falls(self) -> bool:
        """Whether drops or flakes fall before cameras."""
        return self.precipitation > 0.0 or self.snowfall > 0.0

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
        """Extinction that does not depend on height: rain, snow, dust and haze [1/m].

        Rain: fit to the Marshall–Palmer sums (0.0010, 0.0016, 0.0028, 0.0043 1/m at 5, 10, 25, 50 mm/h).
        """
        rain = 3.7e-4 * float(elementary.power(self.rain_mmph, 0.63)) if self.precipitation > 0 else 0.0
        haze = 1.0e-4 * self.mie_scattering_scale / 0.03
        return float(rain + haze + 0.03 * self.dust_storm / 100.0) + snow_extinction_per_m(self.snowfall)

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
        """Wetness of the ground, 0–1; rain and puddles wet it even when `wetness` is 0."""
        soaked = max(self.wetness, 1.5 * self.precipitation, 1.5 * self.precipitation_deposits)
        return min(soaked / 100.0, 1.0)

    @property
    def overcast(self) -> float:
        """Share of the sun's disc that clouds, rain, snow, fog or dust hide, 0–1.

        Fog counts through the vertical optical depth that it puts before the sun.
        """
        clouds = min(max((self.cloudiness - 20.0) / 60.0, 0.0), 1.0)
        falling = self.uniform_extinction_per_m - 1.0e-4 * self.mie_scattering_scale / 0.03
        depth = self.fog_extinction_per_m * self.fog_scale_height_m + 30.0 * falling
        slant = depth / max(elementary.sin(math.radians(max(self.sun_altitude_angle, 5.0))), 0.1)
        return 1.0 - (1.0 - clouds) * float(elementary.exp(-slant))
