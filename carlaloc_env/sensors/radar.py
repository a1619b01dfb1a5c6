"""Imaging radar at 77 GHz: detections of resolution cells, not rays.

Rays find the surfaces in view; each represents a part of a radar cross-section. Parts in one
resolution cell add up, and the cell's echo fluctuates. Echoes above the detector's threshold are
reported with the errors of their signal-to-noise ratio. One frame is one instant.

A radar's detector: fluctuating echoes against a threshold, errors by their strength, false alarms.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from carlaloc_env.core import clock, elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.samples import RadarScan, Sample
from carlaloc_env.sensors.base import Sensor, World
from carlaloc_env.sensors.radar_equation import (
    RadarEchoes,
    detect,
    direction,
    dot,
    errors,
    join,
    mean_snr,
    merge_cells,
    out_of,
    rain_loss_db_per_m,
    snr_at,
)
from carlaloc_env.sensors.radar_targets import RadarView
from carlaloc_env.sensors.ranging_config import RadarConfig
from carlaloc_env.timeline.ego_spline import Motion
from carlaloc_env.timeline.timeline import Timeline
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
        found = [
            self._detect(cells, THING, generator, loss),
            self._detect(ghosts, GHOST, generator, loss),
            self._clutter(generator, motion),
        ]
        range_m, azimuth, elevation, doppler, snr, tag, instance, origin = (
            np.concatenate(column) for column in zip(*found, strict=True)
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
        found, normal = echoes.take(seen), normal[seen]
        values = (found.range_m, found.azimuth_rad, found.elevation_rad, found.doppler_mps)
        measurement = [
            value + errors(measured, size, normal[:, k])
            for k, (value, size) in enumerate(zip(values, self.cell, strict=True))
        ]
        real = origin == THING
        nothing = np.zeros(len(found), np.uint8)
        return (
            *measurement,
            measured,
            found.tag if real else nothing,
            found.instance if real else nothing.astype(np.uint32),
            np.full(len(found), origin, np.uint8),
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


class RadarSensor(Sensor):
    """Gives the detections of one frame per stamp; Doppler is positive when the distance grows.

    A detection of a thing at rest reads −û·v, with û towards it and v the radar's own velocity.
    """

    config: RadarConfig

    def __init__(self, config: RadarConfig, world: World) -> None:
        super().__init__(config)
        self._world = world
        self.padded_streams = (config.stream,)
        self.depends_on_weather = config.weather
        self._T_base_radar = config.mount.T_base_sensor
        self._view = RadarView(config, world)
        self._detector = Detector(config, world)

    def streams(self) -> dict[str, spaces.Space[Any]]:
        """Padded rows: x, y, z [m], Doppler [m/s], SNR [dB], RCS [dBsm]."""
        limit = 1.1 * self.config.range_max_m
        low = np.array([-limit, -limit, -limit, -500.0, -100.0, -200.0], np.float32)
        shape = (self.config.detections_max, 1)
        return {self.config.stream: spaces.Box(np.tile(low, shape), np.tile(-low, shape))}

    def measure(self, timeline: Timeline, stamps_ns: Sequence[int]) -> list[Sample]:
        """One `RadarScan` per stamp [ns]."""
        return [
            self._frame(timeline, int(stamp), [self._world.weather.at(int(stamp))])[0] for stamp in stamps_ns
        ]

    def measure_conditions(
        self, timeline: Timeline, stamp_ns: int, weathers: Sequence[WeatherParameters]
    ) -> list[list[Sample]]:
        """The frame of one instant under several weathers, one list per weather."""
        return [[scan] for scan in self._frame(timeline, int(stamp_ns), weathers)]

    def _frame(
        self, timeline: Timeline, stamp_ns: int, weathers: Sequence[WeatherParameters]
    ) -> list[RadarScan]:
        motion = timeline.ego_motion([stamp_ns]).at_mount(self._T_base_radar)
        scenery, actors, mirrors = self._view.echoes(timeline, stamp_ns, motion)
        cells = merge_cells(join([scenery, actors]), self._detector.cell)
        ghosts = merge_cells(mirrors, self._detector.cell)
        return [self._detector.detections(cells, ghosts, motion, stamp_ns, weather) for weather in weathers]
