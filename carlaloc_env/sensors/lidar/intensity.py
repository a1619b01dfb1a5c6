"""Intensity of LiDAR echoes: strength of surfaces, drop-off, and echoes of the weather.

Weather echoes of LiDAR beams: the strongest of surface, fog, raindrop or flake, and spray.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import F32, Array, Index
from carlaloc_env.raycast import Hits
from carlaloc_env.scene.materials import material_values
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.lidar.atmosphere import GROUND_TAGS, Atmosphere, DropEcho, FogEcho, wet_reflectance
from carlaloc_env.sensors.lidar.kernels import strengths
from carlaloc_env.sensors.lidar.reflection import echo_power, reflection_table

if TYPE_CHECKING:
    from carlaloc_env.sensors.lidar_config import LidarConfig

SURFACE = 255
"""Stands for the tag of a surface among echoes."""
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
    white: float = 100.0,
    spray_m: Array | None,
    uniform: Array,
) -> tuple[Array, NDArray[np.float32], NDArray[np.uint8]]:
    """Strongest echo of every beam.

    Args:
        air: Atmosphere at the sensor's height.
        solid: Echoes of surfaces.
        beam_rad: Width of the beam [rad].
        range_min_m: Nearest return [m].
        power_min: Weakest echo that is seen, in the scale ρ·cosθ/R².
        white: Intensity of a white surface face on.
        spray_m: Where each ray is caught by spray [m], inf where not; None: nowhere.
        uniform: Uniform draws of (0, 1], shape (N, 6).

    Returns:
        Distances [m], inf where no echo is seen, intensities 0–255, and the tags of echoes of the air:
        `SURFACE` for all others.
    """
    surface_m, alpha = solid.range_m, air.extinction_per_m
    fade = elementary.exp(-2.0 * alpha * surface_m)
    change = np.ones(len(surface_m))
    ground = np.flatnonzero(solid.reflectance > 0)
    if air.wetness > 0:
        dry = solid.reflectance[ground]
        change[ground] = wet_reflectance(dry, solid.cos_incidence[ground], air.wetness) / dry
    best = solid.power * change * fade / (surface_m * surface_m)
    echo_hits_m, strength = surface_m.copy(), solid.intensity * change * fade
    tags = np.full(len(surface_m), SURFACE, np.uint8)

    def offer(power: Array, at_m: Array, brightness_m: Array, tag: Tag = Tag.UNLABELED) -> None:
        wins = np.flatnonzero((power > best) & (at_m < surface_m) & (at_m >= range_min_m))
        best[wins], echo_hits_m[wins], tags[wins] = power[wins], at_m[wins], tag
        strength[wins] = white * power[wins] * brightness_m[wins] * brightness_m[wins]

    if air.backscatter_per_m_sr > 0:
        fog = _fog_echo(air)
        normal = np.sqrt(-2.0 * elementary.log(uniform[:, 0])) * elementary.cos(2.0 * math.pi * uniform[:, 1])
        wisp = elementary.exp(_WISP * normal - 0.5 * _WISP * _WISP)
        power, at_m = fog.strongest(surface_m) * wisp, np.zeros(len(surface_m))
        stronger = np.flatnonzero(power > best)
        at_m[stronger] = fog.draw(surface_m[stronger], uniform[stronger, 2])
        # As bright as a surface where the fog's echo peaks, wherever the wisp is.
        offer(power, at_m, np.full(len(surface_m), fog.peak_m))
    if air.rain_mmph > 0 or air.snowfall > 0:
        drops = _drop_echo(air, divergence_rad=beam_rad, range_min_m=range_min_m, power_min=power_min)
        power, at_m = drops.draw(uniform[:, 3:5], best)
        offer(power, at_m, at_m, Tag.SNOW if air.snowfall > 0 else Tag.UNLABELED)
    if spray_m is not None:
        caught = np.isfinite(spray_m)
        away = np.where(caught, spray_m, 1.0)
        echo = _SPRAY_REFLECTANCE * elementary.exp(-2.0 * alpha * away) / (away * away)
        offer(np.where(caught, echo, 0.0), away, away)
    echo_hits_m[best < power_min] = np.inf
    return echo_hits_m, np.clip(strength, 0.0, 255.0).astype(np.float32), tags


class EchoModel:
    """Model of strength and loss of the echoes of one LiDAR."""

    def __init__(self, config: LidarConfig) -> None:
        self._config = config
        self._reflectance = material_values("reflectance")
        self._retro = material_values("retro")
        self._rough = reflection_table() if config.receiver else None

    @property
    def power_min(self) -> float:
        """Weakest echo that is seen: of a 90 % target at the longest range (LISA), or the receiver's."""
        receiver = self._config.receiver
        return 0.1 / receiver.reach_m**2 if receiver else 0.9 / self._config.range_max_m**2

    def strength(self, hits: Hits) -> F32:
        """Return strength 0–255: diffuse surfaces up to `diffuse_intensity`, retro-reflectors above."""
        if self._rough:
            return np.minimum(100.0 * self.power(hits), 255.0).astype(np.float32)
        strength = np.empty(len(hits), np.float32)
        seen = hits.range_m, hits.material, hits.cos_incidence, hits.tone
        scale = self._config.diffuse_intensity, self._config.attenuation_per_m
        strengths(*seen, self._reflectance, self._retro, scale, strength)
        return strength

    def power(self, hits: Hits) -> Array:
        """Strength of echoes without their R⁻²: ρ·cosθ, and ten times as much for retro-reflectors."""
        if self._rough:
            return echo_power(self._rough, hits)
        diffuse = self._reflectance[hits.material] * hits.tone * hits.cos_incidence
        return (diffuse + 10.0 * self._retro[hits.material]).astype(np.float64)

    def is_detected(self, hits: Hits) -> NDArray[np.bool_]:
        """Whether the echo ρ·cosθ/R² exceeds that of a 90 % target at the longest range (LISA)."""
        ratio = (hits.range_m / self._config.range_max_m).astype(np.float64)
        result: NDArray[np.bool_] = self.power(hits) >= 0.9 * ratio * ratio
        return result

    def survives(self, range_m: F32, uniform: Array) -> NDArray[np.bool_]:
        """Whether points survive CARLA's drop-off (RayCastLidar.cpp): some of all, more of the weak."""
        config = self._config
        intensity = elementary.exp(-config.attenuation_per_m * range_m.astype(np.float64))
        slope = config.dropoff_zero_intensity / config.dropoff_intensity_limit
        likely = slope * intensity + 1.0 - config.dropoff_zero_intensity
        strong = intensity > config.dropoff_intensity_limit
        survives: NDArray[np.bool_] = strong | (uniform[:, 1] < likely)
        survives &= uniform[:, 0] >= config.dropoff_general
        return survives

    def in_weather(
        self, hits: Hits, air: Atmosphere, spray_m: Array | None, uniform: Array
    ) -> tuple[Index, Hits, F32]:
        """Echoes of N hits in an atmosphere: the strongest of each ray, with its intensity.

        Echoes of flakes are tagged as snow; those of fog, drops and spray have no tag. None has an instance.

        Args:
            hits: First surfaces.
            air: Atmosphere at the sensor's height.
            spray_m: Where spray catches the rays [m], inf where it does not, shape (N,).
            uniform: Uniform draws of (0, 1], shape (N, 6).

        Returns:
            Rows of the M hits that are left, shape (M,), what they are now, and their strength.
        """
        config = self._config
        ground = np.isin(hits.tag, GROUND_TAGS)
        echoes = SolidEchoes(
            range_m=np.minimum(hits.range_m, np.float32(config.range_max_m)).astype(np.float64),
            power=np.where(np.isfinite(hits.range_m), self.power(hits), 0.0),
            intensity=self.strength(hits).astype(np.float64),
            reflectance=np.where(ground, self._reflectance[hits.material], 0.0).astype(np.float64),
            cos_incidence=hits.cos_incidence.astype(np.float64),
        )
        echo_m, intensity, tags = strongest_echoes(
            air,
            echoes,
            beam_rad=1e-3 * (config.divergence_mrad or BEAM_MRAD),
            range_min_m=config.range_min_m,
            power_min=self.power_min,
            white=config.diffuse_intensity,
            spray_m=spray_m,
            uniform=uniform,
        )
        seen = np.flatnonzero(np.isfinite(echo_m))
        echo_hits = hits.take(seen)
        soft = np.flatnonzero(tags[seen] != SURFACE)
        echo_hits.put(soft, Hits.none(len(soft)))
        echo_hits.range_m[:] = echo_m[seen]
        echo_hits.tag[soft] = tags[seen[soft]]
        echo_hits.cos_incidence[soft] = 1.0
        return seen, echo_hits, intensity[seen]
