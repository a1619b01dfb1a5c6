"""Weather echoes of LiDAR beams: the strongest of surface, fog, raindrop and spray."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.sensors.lidar.atmosphere import Atmosphere, DropEcho, FogEcho, wet_reflectance

BEAM_MRAD = 3.0
"""Width of a beam whose divergence is not given [mrad] (HDL-32E: 2.79 × 1.4)."""
_WISP = 0.5
"""Spread of the logarithm of the fog's density from ray to ray."""
_SPRAY_REFLECTANCE = 0.05
"""Reflectance of spray."""

_fog_echo = lru_cache(maxsize=8)(FogEcho)
"""Fog echoes of the last atmospheres."""
_drop_echo = lru_cache(maxsize=8)(DropEcho)
"""Drop echoes of the last atmospheres and beams."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SolidEchoes:
    """Echoes of surfaces through clear air, of N rays."""

    range_m: Array
    """Distance of the surface, or length of the ray without one [m], shape (N,)."""
    power: Array
    """ρ·cosθ, 0 where there is no surface, shape (N,)."""
    intensity: Array
    """Return strength 0–255, shape (N,)."""
    reflectance: Array
    """Dry reflectance of ground that can be wet, 0 for all else, shape (N,)."""
    cos_incidence: Array
    """Cosine between ray and surface normal, shape (N,)."""


def strongest_echoes(
    air: Atmosphere,
    solid: SolidEchoes,
    *,
    beam_rad: float,
    range_min_m: float,
    power_min: float,
    spray_m: Array | None,
    uniform: Array,
) -> tuple[Array, NDArray[np.float32], NDArray[np.bool_]]:
    """Strongest echo of every beam.

    Args:
        air: Atmosphere at the sensor's height.
        solid: Echoes of surfaces.
        beam_rad: Width of the beam [rad].
        range_min_m: Nearest return [m].
        power_min: Weakest echo that is seen, in the scale ρ·cosθ/R².
        spray_m: Where each ray is caught by spray [m], inf where not; None: nowhere.
        uniform: Uniform draws of (0, 1], shape (N, 6).

    Returns:
        Distances [m], inf where no echo is seen, intensities 0–255, and whether it came from the air.
    """
    surface_m, alpha = solid.range_m, air.extinction_per_m
    fade = elementary.exp(-2.0 * alpha * surface_m)
    change = np.ones(len(surface_m))
    ground = np.flatnonzero(solid.reflectance > 0)
    if air.wetness > 0:
        dry = solid.reflectance[ground]
        change[ground] = wet_reflectance(dry, solid.cos_incidence[ground], air.wetness) / dry
    best = solid.power * change * fade / (surface_m * surface_m)
    found_m, strength = surface_m.copy(), solid.intensity * change * fade
    airborne = np.zeros(len(surface_m), dtype=np.bool_)

    def offer(power: Array, at_m: Array, brightness_m: Array) -> None:
        wins = np.flatnonzero((power > best) & (at_m < surface_m) & (at_m >= range_min_m))
        best[wins], found_m[wins], airborne[wins] = power[wins], at_m[wins], True
        strength[wins] = 100.0 * power[wins] * brightness_m[wins] * brightness_m[wins]

    if air.backscatter_per_m_sr > 0:
        fog = _fog_echo(air)
        normal = np.sqrt(-2.0 * elementary.log(uniform[:, 0])) * elementary.cos(2.0 * math.pi * uniform[:, 1])
        wisp = elementary.exp(_WISP * normal - 0.5 * _WISP * _WISP)
        # As bright as a surface where the fog's echo peaks, wherever the wisp is.
        peaks_m = np.full(len(surface_m), fog.peak_m)
        offer(fog.strongest(surface_m) * wisp, fog.draw(surface_m, uniform[:, 2]), peaks_m)
    if air.rain_mmph > 0:
        drops = _drop_echo(air, divergence_rad=beam_rad, range_min_m=range_min_m, power_min=power_min)
        power, at_m = drops.draw(uniform[:, 3:5])
        offer(power, at_m, at_m)
    if spray_m is not None:
        caught = np.isfinite(spray_m)
        away = np.where(caught, spray_m, 1.0)
        echo = _SPRAY_REFLECTANCE * elementary.exp(-2.0 * alpha * away) / (away * away)
        offer(np.where(caught, echo, 0.0), away, away)
    found_m[best < power_min] = np.inf
    return found_m, np.clip(strength, 0.0, 255.0).astype(np.float32), airborne
