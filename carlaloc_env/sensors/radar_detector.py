"""A radar's detector: fluctuating echoes against a threshold, errors by their strength, false alarms."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import clock, elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.samples import RadarScan
from carlaloc_env.sensors.base import World
from carlaloc_env.sensors.radar_config import RadarConfig
from carlaloc_env.sensors.radar_directions import direction, dot, out_of
from carlaloc_env.sensors.radar_equation import (
    RadarEchoes,
    detect,
    errors,
    mean_snr,
    rain_loss_db_per_m,
    snr_at,
)
from carlaloc_env.timeline.motion import Motion
from carlaloc_env.weather.parameters import WeatherParameters

THING, GHOST, CLUTTER = 0, 1, 2
"""Values of `RadarScan.origin`."""


class Detector:
    """Makes detections of the echoes of resolution cells."""

    cell: tuple[float, float, float, float]
    """Sizes of a cell in range [m], azimuth and elevation [rad], and Doppler [m/s]."""

    def __init__(self, config: RadarConfig, world: World) -> None:
        self._config, self._world = config, world
        self._reference_snr = snr_at(config.reference_pd, config.pfa)
        self._half = config.half_fov_rad
        self.cell = config.cell

    def detections(
        self,
        cells: RadarEchoes,
        ghosts: RadarEchoes,
        motion: Motion,
        stamp_ns: int,
        weather: WeatherParameters,
    ) -> RadarScan:
        """Detections that cross the threshold in one frame, with their errors.

        Args:
            cells: Resolution cells with echoes of things.
            ghosts: Cells with echoes of mirror images.
            motion: Motion of the radar.
            stamp_ns: Time of the frame [ns].
            weather: Its rain weakens echoes, if the radar heeds it.
        """
        config = self._config
        generator = clock.stream(self._world.seed, f"{config.frame_id}/detections", stamp_ns)
        loss = rain_loss_db_per_m(weather.rain_mmph) if config.weather else 0.0
        groups = [
            self._detect(cells, THING, generator, loss),
            self._detect(ghosts, GHOST, generator, loss),
            self._clutter(generator, motion),
        ]
        range_m, azimuth, elevation, doppler, snr, tag, instance, origin = (
            np.concatenate(column) for column in zip(*groups, strict=True)
        )
        keep = np.flatnonzero((range_m >= config.range_min_m) & (range_m <= config.range_max_m))
        keep = keep[np.argsort(-snr[keep], kind="stable")][: config.detections_max]
        keep = keep[np.argsort(range_m[keep], kind="stable")]
        # The ratio that 1 m² has at each position.
        gain = self._mean_snr(range_m[keep], azimuth[keep], elevation[keep], np.ones(len(keep)), loss)
        level = snr[keep]
        return RadarScan(
            sensor=config.stream,
            frame_id=config.frame_id,
            stamp_ns=stamp_ns,
            range_m=range_m[keep].astype(np.float32),
            azimuth_rad=azimuth[keep].astype(np.float32),
            elevation_rad=elevation[keep].astype(np.float32),
            doppler_mps=doppler[keep].astype(np.float32),
            snr_db=(10.0 * elementary.log10(level)).astype(np.float32),
            rcs_dbsm=(10.0 * elementary.log10(level / gain)).astype(np.float32),
            tag=tag[keep].astype(np.uint8),
            instance=instance[keep].astype(np.uint32),
            origin=origin[keep].astype(np.uint8),
        )

    def _mean_snr(
        self, range_m: Array, azimuth_rad: Array, elevation_rad: Array, rcs_m2: Array, loss_db_per_m: float
    ) -> Array:
        """Mean signal-to-noise ratio, linear, (N,); the gain is `edge_loss_db` down at either edge."""
        a, e = azimuth_rad / self._half[0], elevation_rad / self._half[1]
        return mean_snr(
            range_m,
            rcs_m2,
            at_reference=self._reference_snr,
            reference_m=self._config.reference_range_m,
            pattern=elementary.power(10.0, -0.1 * self._config.edge_loss_db * (a * a + e * e)),
            loss_db_per_m=loss_db_per_m,
        )

    def _detect(
        self, echoes: RadarEchoes, origin: int, generator: np.random.Generator, loss_db_per_m: float
    ) -> tuple[NDArray[Any], ...]:
        positions = echoes.range_m, echoes.azimuth_rad, echoes.elevation_rad
        snr = self._mean_snr(*positions, echoes.rcs_m2, loss_db_per_m)
        uniform, normal = 1.0 - generator.random(len(echoes)), generator.standard_normal((len(echoes), 4))
        seen, measured = detect(snr, self._config.pfa, uniform)
        detected, normal = echoes.take(seen), normal[seen]
        values = (detected.range_m, detected.azimuth_rad, detected.elevation_rad, detected.doppler_mps)
        measurement = [
            value + errors(measured, size, normal[:, k])
            for k, (value, size) in enumerate(zip(values, self.cell, strict=True))
        ]
        real = origin == THING
        nothing = np.zeros(len(detected), np.uint8)
        return (
            *measurement,
            measured,
            detected.tag if real else nothing,
            detected.instance if real else nothing.astype(np.uint32),
            np.full(len(detected), origin, np.uint8),
        )

    def _clutter(self, generator: np.random.Generator, motion: Motion) -> tuple[NDArray[Any], ...]:
        """False alarms, even over range and angles, at the Doppler of the world at rest."""
        config = self._config
        count = int(generator.poisson(config.clutter_mean))
        uniform = generator.random((count, 4))
        azimuth, elevation = ((2 * uniform[:, k + 1] - 1) * self._half[k] for k in range(2))
        local = direction(azimuth, elevation)
        doppler = -dot(out_of(motion, local), motion.velocity_world_mps[0])
        # Noise above the threshold exceeds it by an exponential amount (square-law detector).
        level = -elementary.log(config.pfa) - elementary.log(1.0 - uniform[:, 3]) - 1.0
        nothing = np.zeros(count, np.uint8)
        return (
            config.range_min_m + uniform[:, 0] * (config.range_max_m - config.range_min_m),
            azimuth,
            elevation,
            doppler + generator.standard_normal(count) * config.doppler_resolution_mps,
            level,
            nothing,
            nothing.astype(np.uint32),
            np.full(count, CLUTTER, np.uint8),
        )
