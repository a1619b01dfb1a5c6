"""Imaging radar at 77 GHz: detections of resolution cells, not rays.

Rays find the surfaces in view; each represents a part of a radar cross-section. Parts in one
resolution cell add up, and the cell's echo fluctuates. Echoes above the detector's threshold are
reported with the errors of their signal-to-noise ratio. One frame is one instant.

A radar's detector: fluctuating echoes against a threshold, errors by their strength, false alarms.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from carlaloc_env.core import clock, elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.samples import RadarScan, Sample
from carlaloc_env.sensors.base import Mount, Sensor, SensorConfig, World
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
from carlaloc_env.timeline.ego_spline import Motion
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.weather.parameters import WeatherParameters


@dataclass(frozen=True, slots=True, kw_only=True)
class RadarConfig(SensorConfig):
    """A 4-D imaging radar; range, field of view and rate are the CARLA-Loc paper's (Oculii Falcon).

    Resolutions are those usual for 4-D radars of its kind; the paper does not print them.
    """

    kind: ClassVar[str] = "radar"
    sensor: ClassVar[str] = "carlaloc_env.sensors.radar:RadarSensor"

    name: str = "front"
    """Name of the radar; its stream and its frame are ``radar_<name>``."""
    mount: Mount = field(default_factory=Mount)
    """Where it sits on the car; it looks along its x axis."""
    rate_hz: float = 20.0
    """Frames per second [Hz]."""
    range_min_m: float = 1.0
    """Nearest detection [m]."""
    range_max_m: float = 200.0
    """Farthest detection [m]."""
    azimuth_fov_deg: float = 120.0
    """Width of the field of view [deg]."""
    elevation_fov_deg: float = 30.0
    """Height of the field of view [deg]."""
    range_resolution_m: float = 0.5
    """Size of a range cell [m]."""
    azimuth_resolution_deg: float = 1.5
    """Size of an azimuth cell [deg]."""
    elevation_resolution_deg: float = 2.0
    """Size of an elevation cell [deg]."""
    doppler_resolution_mps: float = 0.2
    """Size of a Doppler cell [m/s]."""
    reference_range_m: float = 100.0
    """Distance at which a target of 0 dBsm is detected with `reference_pd` [m]."""
    reference_pd: float = 0.9
    """Probability of detection at the reference, 0.9 = nine frames in ten."""
    pfa: float = 1e-6
    """Probability of a false alarm in one cell; sets the threshold, 1e-6 = −ln(1e-6) = 11.4 dB."""
    clutter_mean: float = 4.0
    """Mean number of false detections in a frame, Poisson distributed, 4 = 1.6 % of 250."""
    ghosts: bool = True
    """Whether mirror images of road users in walls, rails and the road are seen."""
    reflection_loss_db: float = 7.0
    """Loss of a wall's or rail's reflection, each way [dB]; the road's is 5 dB more."""
    edge_loss_db: float = 6.0
    """Two-way loss at the edges of the field of view [dB]."""
    columns: int = 160
    """Rays across the field of view with which scenery is sought."""
    rows: int = 24
    """Rays over its height."""
    rays_per_actor: int = 24
    """Rays aimed at each actor in view."""
    detections_max: int = 500
    """Most detections of a frame; the weakest are left out."""
    weather: bool = False
    """Whether rain weakens echoes (ITU-R P.838-3)."""

    def __post_init__(self) -> None:
        SensorConfig.__post_init__(self)
        what = f"radar '{self.name}'"
        if not 0 < self.range_min_m < self.range_max_m or min(self.cell) <= 0:
            raise ConfigError(f"{what}: needs 0 < range_min_m < range_max_m and resolutions > 0")
        if not (0 < self.azimuth_fov_deg <= 180 and 0 < self.elevation_fov_deg <= 90):
            raise ConfigError(f"{what}: azimuth_fov_deg must lie in 0…180, elevation_fov_deg in 0…90")
        if not (0 < self.pfa < self.reference_pd < 1):
            raise ConfigError(f"{what}: needs 0 < pfa < reference_pd < 1")
        if min(self.columns, self.rows, self.rays_per_actor, self.detections_max) < 1:
            raise ConfigError(f"{what}: columns, rows, rays_per_actor and detections_max must be at least 1")
        if self.clutter_mean < 0:
            raise ConfigError(f"{what}: clutter_mean {self.clutter_mean}; give a number ≥ 0")

    @property
    def half_fov_rad(self) -> tuple[float, float]:
        """Half the width and half the height of the field of view [rad]."""
        return 0.5 * math.radians(self.azimuth_fov_deg), 0.5 * math.radians(self.elevation_fov_deg)

    @property
    def cell(self) -> tuple[float, float, float, float]:
        """Sizes of a cell in range [m], azimuth and elevation [rad], and Doppler [m/s]."""
        azimuth, elevation = (
            math.radians(deg) for deg in (self.azimuth_resolution_deg, self.elevation_resolution_deg)
        )
        return self.range_resolution_m, azimuth, elevation, self.doppler_resolution_mps

    @property
    def stream(self) -> str:
        """Name of the stream."""
        return f"radar_{self.name}"

    @property
    def frame_id(self) -> str:
        """Name of the radar's frame."""
        return self.stream


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
