"""Atmosphere of LiDAR echoes: fog, rain, snow and wet ground as pure functions of range and power.

Powers are in the scale of LISA: a diffuse surface of reflectance ρ met at an angle θ at the distance R gives
ρ·cosθ/R², and the weakest echo that is seen is that of a 90 % target at the longest range. Extinction is the
camera's (`weather.extinction_per_m`).
"""

import math
from dataclasses import dataclass

import numpy as np

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.weather.parameters import MOR_CONTRAST, WeatherParameters
from carlaloc_env.weather.snowfall import ALBEDO, intercept_per_m4, slope_per_m
from carlaloc_env.weather.snowfall import extinction_per_m as snow_extinction_per_m

BACKSCATTER_PER_MOR = 0.046
"""Backscatter of fog β [1/(m sr)] times its optical range [m] (Rasshofer et al. 2011; Hahner et al. 2021)."""
PULSE_S = 20e-9
"""Half-power width of the laser pulse [s] (Hahner et al., "Fog simulation on real LiDAR point clouds")."""
FOCUS_M = 10.0
"""Distance below which the echo is out of focus on the detector, so that ever less of it counts [m].

The form is that of Fang et al., "Intensity correction of terrestrial laser scanning data by estimating
laser transmission function" (2015). The value is ours: in fog of 50 m, it lets bright targets be seen to
the 26 m of LISA's rule. By the model of an HDL-64 of Bijelic et al., "Seeing through fog without seeing
fog" (2020), points vanish there beyond 20 to 30 m. With the whole echo from 1 m on, they did at 12 m.
"""
FLAKE_FOCUS_M = 16.0
"""The same distance for single flakes [m]: the one constant of snow that is fitted, to ranges of real flakes.

An echo of fog fills the whole beam. A flake is a point somewhere in it, and the beam and the field of view
of a receiver beside the laser overlap but partly near by. See docs/winter.md for the figures.
"""
WATER_REFLECTANCE = 0.0198
"""Reflectance of a drop's face, ((n − 1)/(n + 1))² with n = 1.328 at 905 nm."""
FLAKE_REFLECTANCE = 2.0 / 3.0 * ALBEDO
"""Reflectance of a flake: lit from where one looks, a diffuse ball has two thirds of a flat disc's."""
DROP_DENSITY_PER_M4 = 8e6
"""N₀ of Marshall and Palmer, "The distribution of raindrops with size" (1948) [1/m⁴]."""
DROP_MIN_M = 0.05e-3
"""Smallest drop counted [m]."""
GROUND_TAGS = (Tag.ROAD, Tag.ROAD_LINE, Tag.SIDEWALK, Tag.GROUND, Tag.TERRAIN, Tag.BRIDGE)
"""What can stand under water."""
_LIGHT_MPS = 299_792_458.0
"""Speed of light [m/s]."""
_STEP_M = 0.05
"""Step of range at which fog echoes are integrated [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Atmosphere:
    """Atmosphere at one height: extinction and backscatter."""

    extinction_per_m: float
    """Extinction [1/m]: echoes fall as exp(−2αR)."""
    backscatter_per_m_sr: float
    """Backscatter of fog and dust [1/(m sr)]."""
    rain_mmph: float
    """Rain rate [mm/h]."""
    wetness: float
    """How wet the ground is, 0–1."""
    snowfall: float = 0.0
    """Rate of falling snow [mm/h of water]."""


def atmosphere_at(weather: WeatherParameters, height_m: float) -> Atmosphere:
    """Atmosphere of a weather at a height above the ground [m]; fog thins upwards as for the camera."""
    thinned = float(elementary.exp(-max(height_m, 0.0) / weather.fog_scale_height_m))
    fog = weather.fog_extinction_per_m * thinned
    rain = rain_extinction_per_m(weather.rain_mmph)
    total = fog + weather.uniform_extinction_per_m
    haze = max(total - rain - snow_extinction_per_m(weather.snowfall), 0.0)
    return Atmosphere(
        extinction_per_m=total,
        backscatter_per_m_sr=BACKSCATTER_PER_MOR * haze / -float(elementary.log(MOR_CONTRAST)),
        rain_mmph=weather.rain_mmph,
        wetness=weather.surface_wetness,
        snowfall=weather.snowfall,
    )


def rain_extinction_per_m(rain_mmph: float) -> float:
    """Extinction by rain [1/m]: drops of Marshall and Palmer that hide twice their cross-section."""
    return 3.7e-4 * float(elementary.power(rain_mmph, 0.63)) if rain_mmph > 0 else 0.0


class FogEcho:
    """Echo of the fog before a target: strongest a few metres away.

    P_soft(R) = π·β·∫ sin²(πt/2τ)·exp(−2αr)·ξ(r)/r² d(ct/2), r = R − ct/2 (Rasshofer's model in the
    form of Hahner et al. 2021, eq. 8, in the scale of this module).
    """

    def __init__(self, air: Atmosphere, *, range_limit_m: float = 60.0) -> None:
        self.range_m = np.arange(0.0, range_limit_m + _STEP_M, _STEP_M)
        r = np.maximum(self.range_m, 1e-3)
        focused = 1.0 - elementary.exp(-((r / FOCUS_M) ** 2))
        density = focused * elementary.exp(-2 * air.extinction_per_m * r) / r**2
        length = 0.5 * _LIGHT_MPS * 2.0 * PULSE_S
        shape = elementary.sin(math.pi * np.arange(0.0, length, _STEP_M) / length) ** 2
        spread = elementary.convolve(density, shape)[: len(r)] * _STEP_M
        self.power = math.pi * air.backscatter_per_m_sr * spread
        """Echo at each of `range_m`."""
        self.peak_m = float(self.range_m[np.argmax(self.power)])
        """Where the echo is strongest [m]."""
        self._peak = np.maximum.accumulate(self.power)
        self._cumulative = np.cumsum(density)

    def strongest(self, range_m: Array) -> Array:
        """Strongest echo of the fog up to each distance [m], shape (N,)."""
        row = np.minimum(np.maximum(range_m, 0.0) / _STEP_M, len(self._peak) - 1.0).astype(np.intp)
        result: Array = self._peak[row]
        return result

    def draw(self, range_m: Array, uniform: Array) -> Array:
        """Range of the fog echo before each distance [m], shape (N,).

        Drawn in proportion to what each metre sends back, since real fog drifts in wisps.
        """
        row = np.minimum(np.maximum(range_m, 0.0) / _STEP_M, len(self._cumulative) - 1.0).astype(np.intp)
        drawn: Array = np.interp(uniform * self._cumulative[row], self._cumulative, self.range_m)
        return drawn


class DropEcho:
    """The strongest echo of all raindrops or flakes of snow in a beam.

    A drop of diameter D at r sends back ρ_w·exp(−2αr)·min((D/D_beam)², 1)/r² (Goodin et al. 2019;
    Kilic et al., "LISA", 2021). The number of drops whose echo exceeds p is Poisson distributed with a
    mean Λ(p), so the strongest has the distribution exp(−Λ(p)): one number per ray replaces the
    thousands of drops of each beam. Of flakes, which fill more of a near beam, the detector's focus counts,
    too: with `FLAKE_FOCUS_M`, their share, ranges and intensities are those of real snow (docs/winter.md).
    """

    def __init__(
        self,
        air: Atmosphere,
        *,
        divergence_rad: float,
        range_min_m: float,
        power_min: float,
        range_limit_m: float = 60.0,
    ) -> None:
        flakes = air.snowfall > 0
        reflectance = FLAKE_REFLECTANCE if flakes else WATER_REFLECTANCE
        density = intercept_per_m4(air.snowfall) if flakes else DROP_DENSITY_PER_M4
        slope = slope_per_m(air.snowfall) if flakes else 4100.0 * elementary.power(air.rain_mmph, -0.21)
        r = np.linspace(max(range_min_m, 0.5), range_limit_m, 1200)
        radius = r * elementary.tan(0.5 * divergence_rad)
        volume = math.pi * radius * radius * (r[1] - r[0])
        fade = reflectance * elementary.exp(-2 * air.extinction_per_m * r) / r**2
        if flakes:
            fade *= 1.0 - elementary.exp(-((r / FLAKE_FOCUS_M) ** 2))
        # The first step lies just above the weakest flake that is seen, so that none is rounded away.
        least_power = power_min * (1.0 + 1e-9) if flakes else 0.02 * power_min
        weakest, strongest = elementary.log(least_power), elementary.log(fade.max())
        self.power = elementary.exp(np.linspace(weakest, strongest, 240))
        least = 2 * radius * np.sqrt(np.minimum(self.power[:, None] / fade, 1.0))
        larger = elementary.exp(-slope * np.maximum(least, DROP_MIN_M))
        many = density / slope * larger
        many = np.where(self.power[:, None] <= fade, many, 0.0) * volume
        self.expected = np.sum(many, axis=1)
        """Mean number of drops in a beam with a stronger echo than each of `power`."""
        if flakes:
            # The strongest of them is as strong as `power`, no stronger.
            many[:-1] -= many[1:]
        self._range_m, self._cumulative = r, np.cumsum(many, axis=1)

    def draw(self, uniform: Array, best: Array) -> tuple[Array, Array]:
        """Power of the strongest drop's echo and its distance [m] of N beams.

        Args:
            uniform: Uniform draws of (0, 1], shape (N, 2).
            best: Powers of other echoes, shape (N,); drops below them are nowhere.

        Returns:
            Powers, 0 where no drop is strong enough, and distances, 0 where none is stronger, each (N,).
        """
        threshold = -elementary.log(uniform[:, 0])
        row = np.searchsorted(-self.expected, -threshold) - 1
        power = np.where(row >= 0, self.power[np.maximum(row, 0)], 0.0)
        at_m = np.zeros(len(power))
        stronger = np.flatnonzero(power > best)
        stronger = stronger[np.argsort(row[stronger], kind="stable")]
        values, begins = np.unique(row[stronger], return_index=True)
        for k, rows in zip(values, np.split(stronger, begins[1:]), strict=False):
            cumulative = self._cumulative[k]
            at_m[rows] = np.interp(uniform[rows, 1] * cumulative[-1], cumulative, self._range_m)
        return power, at_m


def wet_reflectance(reflectance: Array, cos_incidence: Array, wetness: float) -> Array:
    """Reflectance towards the sensor of ground under a film of water, shape (N,).

    Light passes the surface twice (Fresnel) and is partly held back inside by total reflection:
    ρ' = T(θ)²·ρ / (n²·(1 − 0.47·ρ)) (Lekner and Dorf, "Why some things are darker when wet", Appl. Opt.
    27, 1988; the film as in LiDAR_snow_sim, Hahner et al. 2022). Grazing light is mirrored away.

    Args:
        reflectance: Dry diffuse reflectance, shape (N,).
        cos_incidence: Cosine between ray and surface normal, shape (N,).
        wetness: Fraction of the ground under water, 0–1.
    """
    passed = 1.0 - fresnel(cos_incidence, 1.33)
    inner = passed * passed * reflectance / (1.33**2 * (1.0 - 0.47 * reflectance))
    result: Array = (1.0 - wetness) * reflectance + wetness * inner
    return result


def fresnel(cos_incidence: Array, n: float) -> Array:
    """Reflectance of a smooth surface of refractive index n for unpolarised light, shape (N,)."""
    c = np.clip(cos_incidence, 0.0, 1.0)
    inside = np.sqrt(1.0 - (1.0 - c * c) / (n * n))
    across = (c - n * inside) / (c + n * inside)
    along = (inside - n * c) / (inside + n * c)
    result: Array = 0.5 * (across * across + along * along)
    return result
