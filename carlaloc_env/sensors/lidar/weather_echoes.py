"""Which echo of a beam is the strongest: surface, fog, raindrop or spray."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.sensors.lidar.atmosphere import Air, DropEcho, FogEcho, wet_reflectance

BEAM_MRAD = 3.0
"""Width of a beam whose divergence is not given [mrad] (HDL-32E: 2.79 × 1.4)."""
_WISP = 0.5
"""Spread of the logarithm of the fog's density from ray to ray."""
_SPRAY_REFLECTANCE = 0.05
"""Reflectance of spray."""

_fog_echo = lru_cache(maxsize=8)(FogEcho)
_drop_echo = lru_cache(maxsize=8)(DropEcho)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SolidEchoes:
    """What surfaces would send back through clear air, of N rays."""

    range_m: Array
    """Distance of the surface, or how far the ray reaches [m], shape (N,)."""
    power: Array
    """ρ·cosθ, 0 where there is no surface, shape (N,)."""
    intensity: Array
    """Return strength 0–255, shape (N,)."""
    reflectance: Array
    """Dry reflectance of ground that can be wet, 0 for all else, shape (N,)."""
    cos_incidence: Array
    """Cosine between ray and surface normal, shape (N,)."""


def strongest_echoes(
    air: Air,
    solid: SolidEchoes,
    *,
    beam_rad: float,
    range_min_m: float,
    power_min: float,
    spray_m: Array | None,
    lots: Array,
) -> tuple[Array, NDArray[np.float32], NDArray[np.bool_]]:
    """The strongest echo of every beam.

    Args:
        air: The air.
        solid: Echoes of surfaces.
        beam_rad: Width of the beam [rad].
        range_min_m: Nearest return [m].
        power_min: Weakest echo that is seen, in the scale ρ·cosθ/R².
        spray_m: Where each ray is caught by spray [m], inf where not; None: nowhere.
        lots: Uniform numbers of (0, 1], shape (N, 6).

    Returns:
        Distances [m], inf where no echo is seen, intensities 0–255, and whether it came from the air.
    """
    reach, alpha = solid.range_m, air.extinction_per_m
    fade = np.exp(-2.0 * alpha * reach)
    change = np.ones(len(reach))
    ground = np.flatnonzero(solid.reflectance > 0)
    if air.wetness > 0:
        dry = solid.reflectance[ground]
        change[ground] = wet_reflectance(dry, solid.cos_incidence[ground], air.wetness) / dry
    best = solid.power * change * fade / (reach * reach)
    place, strength = reach.copy(), solid.intensity * change * fade
    airborne = np.zeros(len(reach), dtype=np.bool_)

    def offer(power: Array, at_m: Array, brightness_m: Array) -> None:
        wins = np.flatnonzero((power > best) & (at_m < reach) & (at_m >= range_min_m))
        best[wins], place[wins], airborne[wins] = power[wins], at_m[wins], True
        strength[wins] = 100.0 * power[wins] * brightness_m[wins] * brightness_m[wins]

    if air.backscatter_per_m_sr > 0:
        fog = _fog_echo(air)
        normal = np.sqrt(-2.0 * np.log(lots[:, 0])) * np.cos(2.0 * math.pi * lots[:, 1])
        wisp = np.exp(_WISP * normal - 0.5 * _WISP * _WISP)
        # As bright as a surface where the fog's echo peaks, wherever the wisp is.
        offer(fog.strongest(reach) * wisp, fog.place(reach, lots[:, 2]), np.full(len(reach), fog.peak_m))
    if air.rain_mmph > 0:
        drops = _drop_echo(air, divergence_rad=beam_rad, range_min_m=range_min_m, power_min=power_min)
        power, at_m = drops.draw(lots[:, 3:5])
        offer(power, at_m, at_m)
    if spray_m is not None:
        caught = np.isfinite(spray_m)
        away = np.where(caught, spray_m, 1.0)
        power = np.where(caught, _SPRAY_REFLECTANCE * np.exp(-2.0 * alpha * away) / (away * away), 0.0)
        offer(power, away, away)
    place[best < power_min] = np.inf
    return place, np.clip(strength, 0.0, 255.0).astype(np.float32), airborne
