"""Spinning LiDAR: every ray cast at its own time from where the sensor then was.

A hit is in the sensor's frame at the time of its own ray, as with a real sensor. The plain and the
semantic cloud come from the same rays and carry the same noise.

The scan pattern has the directions and times of the rays of one revolution. A beam that diverges is several
rays, whose energies make one echo.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from carlaloc_env.core import clock, elementary, transforms
from carlaloc_env.core.array_types import F32, Array, Index
from carlaloc_env.raycast import Hits
from carlaloc_env.samples import PointCloud, Sample
from carlaloc_env.scene.materials import tags_in
from carlaloc_env.sensors.base import Sensor, World
from carlaloc_env.sensors.lidar.atmosphere import atmosphere_at, spray_ranges
from carlaloc_env.sensors.lidar.intensity import EchoModel
from carlaloc_env.sensors.lidar.kernels import (
    ColumnMotion,
    PatternRays,
    ScanHits,
    aim,
    empty_points,
    points_of,
)
from carlaloc_env.sensors.ranging_config import OUTPUTS, LidarConfig
from carlaloc_env.sensors.stochastic_processes import white
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.weather.parameters import WeatherParameters

PULSE_LENGTH_M = 0.6
"""Surfaces nearer to each other than this give one echo between them [m]."""
_RING = 0.35
"""Where the rays around the middle lie, in beam widths: the radius that halves the beam's energy."""


def sub_rays(directions: Array, divergence_rad: float) -> Iterator[Array]:
    """Unit directions of four rays around each of N, a beam of full width `divergence_rad`, each (N, 3)."""
    flat = np.stack([-directions[:, 1], directions[:, 0], np.zeros(len(directions))], axis=-1)
    size = np.sqrt(np.sum(flat * flat, axis=-1))[:, None]
    sideways = np.where(size > 1e-9, flat / np.maximum(size, 1e-9), np.array([0.0, 1.0, 0.0]))
    above = transforms.cross(directions, sideways)
    for right, up in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        moved = directions + _RING * divergence_rad * (right * sideways + up * above)
        yield moved / np.sqrt(np.sum(moved * moved, axis=-1))[:, None]


def weigh(beams: list[Hits], power: Callable[[Hits], Array]) -> Hits:
    """One hit per beam out of its rays: the strongest group of surfaces, at its energy's middle.

    Args:
        beams: Hits of S rays of each of N beams, the middle ray first.
        power: ρ·cosθ of hits; echoes fall with R⁻² beyond it.
    """
    ranges = np.stack([hits.range_m.astype(np.float64) for hits in beams])
    met = np.isfinite(ranges)
    safe = np.where(met, ranges, 1.0)
    energy = np.where(met, np.stack([power(hits) for hits in beams]) / (safe * safe), 0.0)
    total, middle = np.zeros_like(ranges), np.zeros_like(ranges)
    for k in range(len(beams)):
        near = met & met[k] & (np.abs(ranges - safe[k]) < PULSE_LENGTH_M)
        group = np.where(near, energy, 0.0)
        total[k] = np.sum(group, axis=0)
        middle[k] = np.sum(group * safe, axis=0) / np.where(total[k] > 0, total[k], 1.0)
    # The middle ray decides between equals, and where nothing reflects at all.
    best = np.argmax(np.where(met, total * (1 + 1e-9 * (np.arange(len(beams)) == 0)[:, None]), -1.0), axis=0)
    result = Hits.none(len(best))
    for k, hits in enumerate(beams):
        rows = np.flatnonzero((best == k) & met[k])
        result.put(rows, hits.take(rows))
        result.range_m[rows] = np.where(total[k, rows] > 0, middle[k, rows], ranges[k, rows])
    return result


class ScanPattern:
    """Rays of one scan in the order of their time; those of one column, in that of firing."""

    ring: NDArray[np.uint16]
    """Beam of each ray, 0 = lowest, shape (rays,)."""
    offset_ns: NDArray[np.uint32]
    """Time of each ray after the sweep began [ns], shape (rays,)."""
    directions: Array
    """Unit directions in the sensor frame, shape (rays, 3)."""

    def __init__(self, config: LidarConfig, world: World) -> None:
        self._config, self._world = config, world
        self._T_base_lidar = config.mount.T_base_sensor
        columns = np.arange(config.columns)
        firing = np.array(config.firing_ns or [0] * len(config.elevations_deg), dtype=np.int64)
        order = np.argsort(firing, kind="stable")
        self._firing_ns = firing[order]
        self._column_ns = np.round(columns * config.sweep_ns / config.columns).astype(np.int64)
        self._column = np.repeat(columns, len(firing))
        self.ring = np.tile(order.astype(np.uint16), config.columns)
        self.directions = self._make_directions(order)
        self._directions_base = transforms.apply(
            transforms.from_rotation(self._T_base_lidar[:3, :3]), self.directions
        )
        if config.sectors:
            self._column_ns = columns * config.sectors // config.columns * config.sweep_ns // config.sectors
            self._firing_ns = np.zeros_like(self._firing_ns)
        self._later_s = np.tile(1e-9 * self._firing_ns, config.columns)
        self.offset_ns = (self._column_ns[:, None] + self._firing_ns).reshape(-1).astype(np.uint32)

    def cast(self, timeline: Timeline, stamp_ns: int, power: Callable[[Hits], Array]) -> tuple[Index, Hits]:
        """Rays that may return something in a scan (M,), and their first hits.

        Args:
            timeline: Where everything is.
            stamp_ns: When the sweep begins [ns].
            power: Strength of echoes, for beams of more than one ray.
        """
        config = self._config
        body, free, free_ns = self._own_body
        world, aimed = self._world.rays(), self.aimed(timeline, stamp_ns, free)
        stamps_ns = stamp_ns + free_ns
        found = world.trace(aimed, stamps_ns, timeline, config.range_max_m)
        if config.divergence_mrad:
            beams = [found]
            for along in sub_rays(aimed[:, 3:].astype(np.float64), 1e-3 * config.divergence_mrad):
                aimed[:, 3:] = along
                beams.append(world.trace(aimed, stamps_ns, timeline, config.range_max_m))
            found = weigh(beams, power)
        if not config.ego_returns:
            return free, found
        hits = dataclasses.replace(body, **{name: getattr(body, name).copy() for name in body.__slots__})
        hits.put(free, found)
        return np.arange(config.rays), hits

    @cached_property
    def _own_body(self) -> tuple[Hits, Index, NDArray[np.int64]]:
        """Hits on the car's own body, rays that pass it, and their times after the sweep began [ns].

        They are the same in every sweep, since body and LiDAR are rigid.
        """
        origins = np.broadcast_to(self._T_base_lidar[:3, 3], self._directions_base.shape)
        own = self._world.rays().cast_ego(origins, self._directions_base, self._config.range_max_m)
        free = np.flatnonzero(~np.isfinite(own.range_m))
        return own, free, self.offset_ns[free].astype(np.int64)

    def aimed(self, timeline: Timeline, stamp_ns: int, rays: Index) -> F32:
        """Some rays at their own times, as `RayScene.trace` takes them, shape (N, 6).

        Poses are read at the start of each column; within its few microseconds the motion is
        continued with constant velocity and rate, which is exact to a nanometre.
        """
        motion = timeline.ego_motion(stamp_ns + self._column_ns)
        aimed = np.empty((len(rays), 6), np.float32)
        aim(
            rays,
            PatternRays(self._column, self._later_s, self._directions_base),
            self._T_base_lidar[:3, 3],
            ColumnMotion(
                position_m=motion.position_m - self._world.rays().middle_m,
                quat_xyzw=motion.quat_xyzw,
                velocity_mps=motion.velocity_world_mps,
                omega_radps=motion.omega_body_radps,
            ),
            aimed,
        )
        return aimed

    def _make_directions(self, order: NDArray[np.intp]) -> Array:
        """Unit directions of all rays in the sensor frame, shape (rays, 3)."""
        config = self._config
        elevation = np.radians(np.array(config.elevations_deg)[order] + config.elevation_offset_deg)
        columns = (np.arange(config.columns)[:, None] + 0.5) / config.columns
        azimuth = math.pi - 2 * math.pi * (columns + self._firing_ns / config.sweep_ns)
        flat = elementary.cos(elevation)
        up = np.broadcast_to(elementary.sin(elevation), azimuth.shape)
        along: Array = np.stack([flat * elementary.cos(azimuth), flat * elementary.sin(azimuth), up], axis=-1)
        return along.reshape(-1, 3)


class LidarSensor(Sensor):
    """Casts one revolution per stamp; rays are ordered by their time, column by column.

    It turns clockwise seen from above; the seam lies straight behind, where the car's own body is.
    """

    config: LidarConfig

    def __init__(self, config: LidarConfig, world: World) -> None:
        super().__init__(config)
        self._world = world
        self.latency_ns = config.sweep_ns
        self.padded_streams = tuple(self._stream_names().values())
        self.depends_on_weather = config.weather
        self._pattern = ScanPattern(config, world)
        self._echoes = EchoModel(config)
        self._last_cast: tuple[Timeline, int, tuple[Index, Hits, F32]] | None = None

    def streams(self) -> dict[str, spaces.Space[Any]]:
        """Padded rows: x, y, z [m], intensity; semantic: x, y, z [m], cos incidence, instance, tag."""
        limit = self.config.range_max_m + 10 * self.config.range_noise_m + 1.0
        low, high = [-limit] * 3, [limit] * 3
        rows = {
            "cloud": ([*low, 0.0], [*high, 255.0]),
            "semantic": ([*low, 0.0, 0.0, 0.0], [*high, 1.0, 2.0**32, 255.0]),
        }
        shape = (self.config.rays, 1)
        found: dict[str, spaces.Space[Any]] = {}
        for output, stream in self._stream_names().items():
            lowest, highest = (np.tile(np.array(row, np.float32), shape) for row in rows[output])
            found[stream] = spaces.Box(lowest, highest)
        return found

    def measure(self, timeline: Timeline, stamps_ns: Sequence[int]) -> list[Sample]:
        """The clouds of the sweeps that begin at the given stamps [ns]."""
        clouds: list[Sample] = []
        for stamp in map(int, stamps_ns):
            clouds += self.measure_conditions(timeline, stamp, [self._world.weather.at(stamp)])[0]
        return clouds

    def measure_conditions(
        self, timeline: Timeline, stamp_ns: int, weathers: Sequence[WeatherParameters]
    ) -> list[list[Sample]]:
        """The clouds of one sweep under several weathers; rays are cast once."""
        config = self.config
        with ThreadPoolExecutor(1) as beside:
            # One number for every ray that is fired, so that a car in the way of some rays does not
            # change the noise of the others.
            drawn = beside.submit(white, self._world.seed, f"{config.name}/range", stamp_ns, config.rays)
            rays, hits, strength = self._cast(timeline, stamp_ns)
            noise = drawn.result()
        if not config.weather:
            clouds = self._clouds(stamp_ns, noise, rays, hits, strength)
            return [clouds for _ in weathers]
        seen = (self._in_weather(timeline, stamp_ns, rays, hits, weather) for weather in weathers)
        return [self._clouds(stamp_ns, noise, *found) for found in seen]

    def _cast(self, timeline: Timeline, stamp_ns: int) -> tuple[Index, Hits, F32]:
        """Rays of a sweep, their hits and how strong those are in clear air.

        Asked for again, as under another seed, they are not cast again.
        """
        last = self._last_cast
        if last is None or last[0] is not timeline or last[1] != stamp_ns:
            rays, hits = self._pattern.cast(timeline, stamp_ns, self._echoes.power)
            # In weather, strengths are worked out together with the echoes.
            strength = np.empty(0, np.float32) if self.config.weather else self._echoes.strength(hits)
            last = self._last_cast = timeline, stamp_ns, (rays, hits, strength)
        return last[2]

    def _stream_names(self) -> dict[str, str]:
        names = {"cloud": self.config.name, "semantic": f"{self.config.name}_semantic"}
        return {output: names[output] for output in OUTPUTS if output in self.config.outputs}

    def _clouds(self, stamp_ns: int, noise: Array, rays: Index, hits: Hits, intensity: F32) -> list[Sample]:
        """Samples of what rays met, those out of range and dropped ones left out."""
        config, pattern, seed = self.config, self._pattern, self._world.seed
        kept = np.flatnonzero((hits.range_m >= config.range_min_m) & (hits.range_m <= config.range_max_m))
        if config.drop_weak and not config.weather:
            kept = kept[self._echoes.is_detected(hits.take(kept))]
        if config.dropoff_general or config.dropoff_zero_intensity:
            uniform = clock.stream(seed, f"{config.name}/dropoff", stamp_ns).random((config.rays, 2))
            kept = kept[self._echoes.survives(hits.range_m[kept], uniform[rays[kept]])]
        points = empty_points(len(kept))
        scan = ScanHits(
            ray=rays,
            range_m=hits.range_m,
            intensity=intensity,
            tag=hits.tag,
            instance=hits.instance,
            cos_incidence=hits.cos_incidence,
            direction=pattern.directions,
            noise=noise,
            ring=pattern.ring,
            offset_ns=pattern.offset_ns,
        )
        points_of(kept, scan, config.range_noise_m, points)
        clouds: list[Sample] = []
        for output, stream in self._stream_names().items():
            labelled = output == "semantic"
            clouds.append(
                PointCloud(
                    sensor=stream,
                    frame_id=config.frame_id,
                    stamp_ns=stamp_ns,
                    points_xyz_m=points.xyz_m,
                    intensity=points.intensity,
                    ring=points.ring,
                    offset_ns=points.offset_ns,
                    sweep_ns=config.sweep_ns,
                    tag=tags_in(config.tag_table, points.tag) if labelled else None,
                    instance=points.instance if labelled else None,
                    cos_incidence=points.cos_incidence if labelled else None,
                )
            )
        return clouds

    def _in_weather(
        self, timeline: Timeline, stamp_ns: int, rays: Index, hits: Hits, weather: WeatherParameters
    ) -> tuple[Index, Hits, F32]:
        """Rays, what they return under a weather, and how strongly."""
        config = self.config
        air = atmosphere_at(weather, float(config.mount.T_base_sensor[2, 3]))
        drawn = clock.stream(self._world.seed, f"{config.name}/air", stamp_ns).random((config.rays, 6))
        uniform = (1.0 - drawn)[rays]
        spray = None
        if air.wetness > 0 and len(timeline.catalog):
            aimed = self._pattern.aimed(timeline, stamp_ns, rays)
            spray = spray_ranges(
                aimed[:, :3] + self._world.rays().middle_m,
                aimed[:, 3:],
                np.minimum(hits.range_m, np.float32(config.range_max_m)),
                stamp_ns + config.sweep_ns // 2,
                timeline,
                wetness=air.wetness,
                uniform=uniform[:, 5],
            )
        seen, found, intensity = self._echoes.in_weather(hits, air, spray, uniform)
        return rays[seen], found, intensity
