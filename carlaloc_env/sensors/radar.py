"""Imaging radar at 77 GHz: detections of resolution cells, not rays.

Rays find what is in view; each stands for a share of a radar cross-section. Shares that fall into
one resolution cell add up, the cell's echo fluctuates, and what crosses the detector's threshold
is reported with the errors of its signal-to-noise ratio. One frame is one instant.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from carlaloc_env import geometry, rng
from carlaloc_env.errors import ConfigError
from carlaloc_env.raycast import Hits
from carlaloc_env.samples import RadarScan, Sample
from carlaloc_env.sensors.base import Mount, Sensor, SensorConfig, World
from carlaloc_env.sensors.boxes import Boxes, boxes_at
from carlaloc_env.sensors.radar_echo import (
    Echoes,
    detect,
    errors,
    join,
    mean_snr,
    merge_cells,
    rain_loss_db_per_m,
    snr_at,
)
from carlaloc_env.sensors.radar_ghosts import mirror_images
from carlaloc_env.sensors.radar_targets import actor_rcs_dbsm, scenery_db, texture
from carlaloc_env.timeline import Timeline
from carlaloc_env.trajectory import Motion
from carlaloc_env.weather import WeatherParameters

Array = NDArray[np.float64]

THING, GHOST, CLUTTER = 0, 1, 2
"""Values of `RadarScan.origin`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RadarConfig(SensorConfig):
    """A 4-D imaging radar; range, field of view and rate are the CARLA-Loc paper's (Oculii Falcon).

    Resolutions are those usual for 4-D radars of its kind; the paper does not print them.
    """

    kind: ClassVar[str] = "radar"

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
        cells = (
            self.range_resolution_m,
            self.azimuth_resolution_deg,
            self.elevation_resolution_deg,
            self.doppler_resolution_mps,
        )
        if not 0 < self.range_min_m < self.range_max_m or min(cells) <= 0:
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
    def stream(self) -> str:
        """Name of the stream."""
        return f"radar_{self.name}"

    @property
    def frame_id(self) -> str:
        """Name of the radar's frame."""
        return self.stream

    def build(self, world: World) -> RadarSensor:
        """The radar in a world."""
        return RadarSensor(self, world)


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
        self._reference_snr = snr_at(config.reference_pd, config.pfa)
        self._half = (
            0.5 * math.radians(config.azimuth_fov_deg),
            0.5 * math.radians(config.elevation_fov_deg),
        )
        self._cell = (
            config.range_resolution_m,
            math.radians(config.azimuth_resolution_deg),
            math.radians(config.elevation_resolution_deg),
            config.doppler_resolution_mps,
        )

    def streams(self) -> dict[str, spaces.Space[Any]]:
        """Padded rows: x, y, z [m], Doppler [m/s], SNR [dB], RCS [dBsm]."""
        reach = 1.1 * self.config.range_max_m
        low = np.array([-reach, -reach, -reach, -500.0, -100.0, -200.0], np.float32)
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
        boxes = self._near(boxes_at(timeline, stamp_ns), motion)
        scenery, actors, mirrors = self._look(timeline, stamp_ns, motion, boxes)
        cells = merge_cells(join([scenery, actors]), self._cell)
        ghosts = merge_cells(mirrors, self._cell)
        return [self._detections(cells, ghosts, motion, stamp_ns, weather) for weather in weathers]

    def _near(self, boxes: Boxes, motion: Motion) -> Boxes:
        """Boxes of which a part may be in view."""
        local = _into(motion, boxes.centre_m - motion.position_m[0])
        distance, azimuth, elevation = polar(local)
        reach = 0.5 * np.sqrt(np.sum(boxes.size_m * boxes.size_m, axis=-1))
        slack = np.where(
            distance > reach, np.arcsin(np.minimum(reach / np.maximum(distance, 1e-3), 1.0)), np.pi
        )
        seen = distance - reach < self.config.range_max_m
        seen &= (np.abs(azimuth) < self._half[0] + slack) & (np.abs(elevation) < self._half[1] + slack)
        return boxes.take(np.flatnonzero(seen))

    def _look(
        self, timeline: Timeline, stamp_ns: int, motion: Motion, boxes: Boxes
    ) -> tuple[Echoes, Echoes, Echoes]:
        """Echoes of scenery, of actors, and of their mirror images."""
        config = self.config
        generator = rng.stream(self._world.seed, f"{config.frame_id}/rays", stamp_ns)
        grid = self._grid(generator)
        aimed_at = np.repeat(np.arange(len(boxes)), config.rays_per_actor)
        inside = (generator.random((len(aimed_at), 3)) - 0.5) * 0.9 * boxes.size_m[aimed_at]
        origin = motion.position_m[0]
        towards = boxes.to_world(aimed_at, inside) - origin
        aimed_m = np.maximum(np.sqrt(np.sum(towards * towards, axis=-1)), 1e-6)
        directions = np.concatenate([_out_of(motion, grid), towards / aimed_m[:, None]])

        def cast(origins_m: Array, along: Array) -> Hits:
            when = np.full(len(along), stamp_ns, dtype=np.int64)
            return self._world.rays().cast(origins_m, along, when, timeline, config.range_max_m, ego=False)

        hits = cast(np.broadcast_to(origin, directions.shape), directions)
        count = len(grid)
        static = np.flatnonzero(np.isfinite(hits.range_m[:count]) & ~np.isin(hits.instance[:count], boxes.id))
        scenery = self._scenery(hits.take(static), directions[static], grid[static], motion)
        mine = hits.take(np.arange(count, len(hits)))
        actors, of_box = self._actors(mine, directions[count:], aimed_at, aimed_m, boxes, motion)
        mirrors = actors.take(np.zeros(0, np.intp))
        if config.ghosts and len(of_box):
            mirrors = mirror_images(
                actors, of_box, boxes, hits.take(static), directions[static], motion, cast,
                loss_db=config.reflection_loss_db, generator=generator,
            )  # fmt: skip
        return scenery, self._in_view(actors), self._in_view(mirrors)

    def _grid(self, generator: np.random.Generator) -> Array:
        """Directions over the field of view, one in every part of an even grid, sensor frame (M, 3)."""
        columns, rows = self.config.columns, self.config.rows
        place = generator.random((rows, columns, 2))
        azimuth = ((np.arange(columns) + place[..., 0]) / columns * 2 - 1) * self._half[0]
        elevation = ((np.arange(rows)[:, None] + place[..., 1]) / rows * 2 - 1) * self._half[1]
        flat = np.cos(elevation)
        return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=-1).reshape(
            -1, 3
        )

    def _scenery(self, hits: Hits, directions: Array, local: Array, motion: Motion) -> Echoes:
        """Each ray stands for the projected area R²·dΩ, whose cross-section is γ times as large."""
        distance, azimuth, elevation = polar(local * hits.range_m[:, None].astype(np.float64))
        solid = 4 * self._half[0] * self._half[1] / (self.config.columns * self.config.rows)
        area = distance * distance * solid * np.cos(elevation)
        strength = texture(motion.position_m[0] + distance[:, None] * directions)
        return Echoes(
            range_m=distance,
            azimuth_rad=azimuth,
            elevation_rad=elevation,
            doppler_mps=-_dot(directions, motion.velocity_world_mps[0]),
            rcs_m2=area * strength * 10.0 ** (0.1 * scenery_db(hits.tag, hits.cos_incidence)),
            tag=hits.tag,
            instance=hits.instance,
        )

    def _actors(
        self,
        hits: Hits,
        directions: Array,
        aimed_at: NDArray[np.intp],
        aimed_m: Array,
        boxes: Boxes,
        motion: Motion,
    ) -> tuple[Echoes, NDArray[np.intp]]:
        """Each ray that meets its actor carries an even share of the cross-section of what is visible.

        Rays that pass the actor by say nothing; those that something else stops take their share away.
        """
        met = hits.instance == boxes.id[aimed_at]
        stopped = ~met & (hits.range_m < aimed_m - 1.0)
        told = np.bincount(aimed_at[met | stopped], minlength=len(boxes))
        rows = np.flatnonzero(met)
        of_box = aimed_at[rows]
        distance = hits.range_m[rows].astype(np.float64)
        along = directions[rows]
        points = motion.position_m[0] + distance[:, None] * along
        _, azimuth, elevation = polar(_into(motion, along))
        to_radar = motion.position_m[0] - boxes.centre_m
        aspect = np.arctan2(to_radar[:, 1], to_radar[:, 0]) - boxes.heading_rad
        whole = 10.0 ** (0.1 * actor_rcs_dbsm(boxes.tag, aspect))
        closing = boxes.velocity_at(of_box, points) - motion.velocity_world_mps[0]
        echoes = Echoes(
            range_m=distance,
            azimuth_rad=azimuth,
            elevation_rad=elevation,
            doppler_mps=_dot(along, closing),
            rcs_m2=whole[of_box] / np.maximum(told[of_box], 1),
            tag=boxes.tag[of_box],
            instance=boxes.id[of_box],
        )
        return echoes, of_box

    def _in_view(self, echoes: Echoes) -> Echoes:
        inside = (np.abs(echoes.azimuth_rad) <= self._half[0]) & (
            np.abs(echoes.elevation_rad) <= self._half[1]
        )
        return echoes.take(np.flatnonzero(inside))

    def _detections(
        self, cells: Echoes, ghosts: Echoes, motion: Motion, stamp_ns: int, weather: WeatherParameters
    ) -> RadarScan:
        config = self.config
        generator = rng.stream(self._world.seed, f"{config.frame_id}/detections", stamp_ns)
        loss = rain_loss_db_per_m(weather.rain_mmph) if config.weather else 0.0
        found = [
            self._detect(cells, THING, generator, loss),
            self._detect(ghosts, GHOST, generator, loss),
            self._clutter(generator, motion),
        ]
        range_m, azimuth, elevation, doppler, snr, tag, instance, origin = (
            np.concatenate(column) for column in zip(*found, strict=True)
        )
        inside = (range_m >= config.range_min_m) & (range_m <= config.range_max_m)
        keep = np.flatnonzero(inside)
        keep = keep[np.argsort(-snr[keep], kind="stable")][: config.detections_max]
        keep = keep[np.argsort(range_m[keep], kind="stable")]
        gain = mean_snr_of_unit(self, range_m[keep], azimuth[keep], elevation[keep], loss_db_per_m=loss)
        level = snr[keep]
        return RadarScan(
            sensor=config.stream,
            frame_id=config.frame_id,
            stamp_ns=stamp_ns,
            range_m=range_m[keep].astype(np.float32),
            azimuth_rad=azimuth[keep].astype(np.float32),
            elevation_rad=elevation[keep].astype(np.float32),
            doppler_mps=doppler[keep].astype(np.float32),
            snr_db=(10.0 * np.log10(level)).astype(np.float32),
            rcs_dbsm=(10.0 * np.log10(level / gain)).astype(np.float32),
            tag=tag[keep].astype(np.uint8),
            instance=instance[keep].astype(np.uint32),
            origin=origin[keep].astype(np.uint8),
        )

    def pattern(self, azimuth_rad: Array, elevation_rad: Array) -> Array:
        """Two-way antenna gain relative to the axis, linear: `edge_loss_db` down at either edge."""
        a, e = azimuth_rad / self._half[0], elevation_rad / self._half[1]
        result: Array = 10.0 ** (-0.1 * self.config.edge_loss_db * (a * a + e * e))
        return result

    def _detect(
        self, echoes: Echoes, origin: int, generator: np.random.Generator, loss_db_per_m: float
    ) -> tuple[NDArray[Any], ...]:
        config = self.config
        snr = mean_snr(
            echoes,
            at_reference=self._reference_snr,
            reference_m=config.reference_range_m,
            pattern=self.pattern(echoes.azimuth_rad, echoes.elevation_rad),
            loss_db_per_m=loss_db_per_m,
        )
        uniform, normal = 1.0 - generator.random(len(echoes)), generator.standard_normal((len(echoes), 4))
        seen, measured = detect(snr, config.pfa, uniform)
        found, normal = echoes.take(seen), normal[seen]
        values = (found.range_m, found.azimuth_rad, found.elevation_rad, found.doppler_mps)
        measurement = [
            value + errors(measured, size, normal[:, k])
            for k, (value, size) in enumerate(zip(values, self._cell, strict=True))
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
        config = self.config
        count = int(generator.poisson(config.clutter_mean))
        place = generator.random((count, 4))
        azimuth, elevation = ((2 * place[:, k + 1] - 1) * self._half[k] for k in range(2))
        flat = np.cos(elevation)
        local = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=-1)
        doppler = -_dot(_out_of(motion, local), motion.velocity_world_mps[0])
        # Noise above the threshold exceeds it by an exponential amount (square-law detector).
        level = -math.log(config.pfa) - np.log(1.0 - place[:, 3]) - 1.0
        nothing = np.zeros(count, np.uint8)
        return (
            config.range_min_m + place[:, 0] * (config.range_max_m - config.range_min_m),
            azimuth,
            elevation,
            doppler + generator.standard_normal(count) * config.doppler_resolution_mps,
            level,
            nothing,
            nothing.astype(np.uint32),
            np.full(count, CLUTTER, np.uint8),
        )


def mean_snr_of_unit(
    radar: RadarSensor, range_m: Array, azimuth_rad: Array, elevation_rad: Array, *, loss_db_per_m: float
) -> Array:
    """Mean signal-to-noise ratio that 1 m² has at each place, linear, shape (N,)."""
    count = len(range_m)
    unit = Echoes(
        range_m=range_m,
        azimuth_rad=azimuth_rad,
        elevation_rad=elevation_rad,
        doppler_mps=np.zeros(count),
        rcs_m2=np.ones(count),
        tag=np.zeros(count, np.uint8),
        instance=np.zeros(count, np.uint32),
    )
    return mean_snr(
        unit,
        at_reference=snr_at(radar.config.reference_pd, radar.config.pfa),
        reference_m=radar.config.reference_range_m,
        pattern=radar.pattern(azimuth_rad, elevation_rad),
        loss_db_per_m=loss_db_per_m,
    )


def polar(local_m: Array) -> tuple[Array, Array, Array]:
    """Distance [m], azimuth and elevation [rad] of points (N, 3) in a sensor's frame."""
    flat = np.sqrt(local_m[:, 0] * local_m[:, 0] + local_m[:, 1] * local_m[:, 1])
    distance = np.sqrt(flat * flat + local_m[:, 2] * local_m[:, 2])
    return distance, np.arctan2(local_m[:, 1], local_m[:, 0]), np.arctan2(local_m[:, 2], flat)


def _into(motion: Motion, vectors: Array) -> Array:
    return geometry.quat_rotate(geometry.quat_conjugate(motion.quat_xyzw), vectors)


def _out_of(motion: Motion, vectors: Array) -> Array:
    return geometry.quat_rotate(motion.quat_xyzw, vectors)


def _dot(vectors: Array, other: Array) -> Array:
    product = vectors * other
    result: Array = product[:, 0] + product[:, 1] + product[:, 2]
    return result
