"""Intensity of LiDAR echoes: strength of surfaces, drop-off, and echoes of the weather."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import F32, Array, Index
from carlaloc_env.raycast import Hits
from carlaloc_env.scene.materials import material_values
from carlaloc_env.sensors.lidar.atmosphere import GROUND_TAGS, Atmosphere
from carlaloc_env.sensors.lidar.kernels import strengths
from carlaloc_env.sensors.lidar.weather_echoes import BEAM_MRAD, SolidEchoes, strongest_echoes

if TYPE_CHECKING:
    from carlaloc_env.sensors.lidar.config import LidarConfig


class EchoModel:
    """Model of strength and loss of the echoes of one LiDAR."""

    def __init__(self, config: LidarConfig) -> None:
        self._config = config
        self._reflectance = material_values("reflectance")
        self._retro = material_values("retro")

    def strength(self, hits: Hits) -> F32:
        """Return strength 0–255: diffuse surfaces up to 100, retro-reflectors above (Velodyne's scale)."""
        strength, seen = np.empty(len(hits), np.float32), (hits.range_m, hits.material, hits.cos_incidence)
        strengths(*seen, self._reflectance, self._retro, self._config.attenuation_per_m, strength)
        return strength

    def power(self, hits: Hits) -> Array:
        """Strength of echoes without their R⁻²: ρ·cosθ, and ten times as much for retro-reflectors."""
        diffuse = self._reflectance[hits.material] * hits.cos_incidence
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

        Echoes of fog, drops and spray have no tag and no instance.

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
        echo_m, intensity, airborne = strongest_echoes(
            air,
            echoes,
            beam_rad=1e-3 * (config.divergence_mrad or BEAM_MRAD),
            range_min_m=config.range_min_m,
            power_min=0.9 / config.range_max_m**2,
            spray_m=spray_m,
            uniform=uniform,
        )
        seen = np.flatnonzero(np.isfinite(echo_m))
        found = hits.take(seen)
        soft = np.flatnonzero(airborne[seen])
        found.put(soft, Hits.none(len(soft)))
        found.range_m[:] = echo_m[seen]
        found.cos_incidence[soft] = 1.0
        return seen, found, intensity[seen]
