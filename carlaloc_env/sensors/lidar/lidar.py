"""Spinning LiDAR: every ray cast at its own time from where the sensor then was.

A hit is in the sensor's frame at the time of its own ray, as with a real sensor. The plain and the
semantic cloud come from the same rays and carry the same noise.

The scan pattern has the directions and times of the rays of one revolution. A beam that diverges is several
rays, whose energies make one echo. With a receiver, only beams on edges are cast in parts.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from threading import Thread
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from carlaloc_env.assets.vehicles.roof_rack import roof_rack
from carlaloc_env.core import clock, elementary, transforms
from carlaloc_env.core.array_types import F32, Array, Index
from carlaloc_env.raycast import Hits
from carlaloc_env.samples import PointCloud, Sample
from carlaloc_env.sensors.base import Sensor, World
from carlaloc_env.sensors.lidar.atmosphere import atmosphere_at, spray_ranges
from carlaloc_env.sensors.lidar.beams import on_edges, part_beams, sub_rays, weigh
from carlaloc_env.sensors.lidar.intensity import EchoModel
from carlaloc_env.sensors.lidar.kernels import (
    ColumnMotion,
    PatternRays,
    ScanHits,
    aim,
    empty_points,
    points_of,
)
from carlaloc_env.sensors.lidar.receiver import Receiver, ground_relief
from carlaloc_env.sensors.lidar.surface_details import surface_details
from carlaloc_env.sensors.ranging_config import OUTPUTS, LidarConfig
from carlaloc_env.sensors.stochastic_processes import white
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.weather.parameters import WeatherParameters


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cast:
    """Rays of a scan that may return something, M of them, and what they meet."""

    rays: Index
    """Numbers of the rays, shape (M,)."""
    hits: Hits
    """First hits, shape (M,)."""
    share: F32
    """Energy that each hit returns over that of a whole beam on its material, shape (M,)."""
    relief_m: F32
    """Height of the surface above its mesh at each hit [m], shape (M,)."""


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

    def cast(self, timeline: Timeline, stamp_ns: int, power: Callable[[Hits], Array]) -> Cast:
        """Rays that may return something in a scan, and their first hits.

        Args:
            timeline: Where everything is.
            stamp_ns: When the sweep begins [ns].
            power: Strength of echoes, for beams of more than one ray.
        """
        config = self._config
        body, free, free_ns = self._own_body
        world, aimed = self._world.rays(), self.aimed(timeline, stamp_ns, free)
        stamps_ns = stamp_ns + free_ns
        share, relief_m = np.ones(config.rays, np.float32), np.zeros(config.rays, np.float32)
        found = world.trace(aimed, stamps_ns, timeline, config.range_max_m)
        if config.receiver:
            if config.receiver.edge_rays:
                range_m, material = body.range_m.copy(), body.material.copy()
                range_m[free], material[free] = found.range_m, found.material
                edges = np.flatnonzero(on_edges(range_m, material, config.columns)[free])
                along = part_beams(aimed[edges, 3:].astype(np.float64), config.receiver)
                mixed, share[free[edges]] = self._mixed(
                    found.take(edges), aimed[edges], along, stamps_ns[edges], timeline, power
                )
                found.put(edges, mixed)
            if config.receiver.relief:
                rows, coat, height_m = surface_details(aimed, found, world.middle_m)
                share[free[rows]] *= coat
                if self._world.roughness is not None:
                    place = (*world.middle_m[:2].tolist(), 1e-3 * config.receiver.beam_mrad[1])
                    relief_m[free] = ground_relief(aimed, found, self._world.roughness, place)
                relief_m[free[rows]] += height_m
        elif config.divergence_mrad:
            along = sub_rays(aimed[:, 3:].astype(np.float64), 1e-3 * config.divergence_mrad)
            found, _ = self._mixed(found, aimed, along, stamps_ns, timeline, power)
        if not config.ego_returns:
            return Cast(rays=free, hits=found, share=share[free], relief_m=relief_m[free])
        hits = dataclasses.replace(body, **{name: getattr(body, name).copy() for name in body.__slots__})
        hits.put(free, found)
        return Cast(rays=np.arange(config.rays), hits=hits, share=share, relief_m=relief_m)

    def _mixed(
        self,
        middle: Hits,
        aimed: F32,
        directions: Iterator[Array],
        stamps_ns: NDArray[np.int64],
        timeline: Timeline,
        power: Callable[[Hits], Array],
    ) -> tuple[Hits, Array]:
        """What beams of several rays return, as `weigh` gives it.

        Args:
            middle: Hits of the middle rays.
            aimed: The middle rays, as `RayScene.trace` takes them, shape (N, 6).
            directions: Unit directions of the other rays, world, each (N, 3).
            stamps_ns: When each beam is cast [ns], shape (N,).
            timeline: Where everything is.
            power: Strength of echoes.
        """
        parts = list(directions)
        rays = np.tile(aimed, (len(parts), 1))
        rays[:, 3:] = np.concatenate(parts)
        hits = self._world.rays().trace(
            rays, np.tile(stamps_ns, len(parts)), timeline, self._config.range_max_m
        )
        beams = [middle, *(hits.take(part) for part in np.arange(len(rays)).reshape(len(parts), -1))]
        return weigh(beams, power)

    @cached_property
    def _own_body(self) -> tuple[Hits, Index, NDArray[np.int64]]:
        """Hits on the car's own body, rays that pass it, and their times after the sweep began [ns].

        They are the same in every sweep, since body and LiDAR are rigid.
        """
        origins = np.broadcast_to(self._T_base_lidar[:3, 3], self._directions_base.shape)
        own = self._world.rays().cast_ego(
            origins,
            self._directions_base,
            self._config.range_max_m,
            roof_rack() if self._config.roof_rack else None,
        )
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
        self._receiver: Receiver | None = None
        self._last_cast: tuple[Timeline, int, tuple[Cast, F32]] | None = None

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
        # One number for every ray that is fired, so that a car in the way of some rays does not change the
        # noise of the others. Drawn beside the casting, in a thread: an executor costs several times as much.
        noise, draw = np.empty(config.rays), clock.stream(self._world.seed, f"{config.name}/range", stamp_ns)
        beside = Thread(target=draw.standard_normal, kwargs={"out": noise})
        beside.start()
        cast, strength = self._cast(timeline, stamp_ns)
        beside.join()
        if not config.weather:
            clouds = self._clouds(stamp_ns, noise, cast, strength)
            return [clouds for _ in weathers]
        seen = (self._in_weather(timeline, stamp_ns, cast, weather) for weather in weathers)
        return [self._clouds(stamp_ns, noise, *found) for found in seen]

    def _cast(self, timeline: Timeline, stamp_ns: int) -> tuple[Cast, F32]:
        """Rays of a sweep, what they meet and how strong that is in clear air.

        Asked for again, as under another seed, they are not cast again.
        """
        last = self._last_cast
        if last is None or last[0] is not timeline or last[1] != stamp_ns:
            cast = self._pattern.cast(timeline, stamp_ns, self._echoes.power)
            # In weather, strengths are worked out together with the echoes.
            strength = np.empty(0, np.float32) if self.config.weather else self._echoes.strength(cast.hits)
            last = self._last_cast = timeline, stamp_ns, (cast, strength)
        return last[2]

    def _stream_names(self) -> dict[str, str]:
        names = {"cloud": self.config.name, "semantic": f"{self.config.name}_semantic"}
        return {output: names[output] for output in OUTPUTS if output in self.config.outputs}

    def _clouds(self, stamp_ns: int, noise: Array, cast: Cast, intensity: F32) -> list[Sample]:
        """Samples of what rays met, those out of range and dropped ones left out."""
        config, pattern, seed = self.config, self._pattern, self._world.seed
        rays, hits, noise_m = cast.rays, cast.hits, config.range_noise_m
        if config.receiver:
            hits, intensity = self._received(stamp_ns, noise, cast, intensity)
            noise_m = 0.0
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
        points_of(kept, scan, noise_m, points)
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
                    tag=points.tag if labelled else None,
                    instance=points.instance if labelled else None,
                    cos_incidence=points.cos_incidence if labelled else None,
                )
            )
        return clouds

    def _received(self, stamp_ns: int, noise: Array, cast: Cast, intensity: F32) -> tuple[Hits, F32]:
        """Hits at their measured ranges, those without an echo at infinity, and measured intensities."""
        config, seed = self.config, self._world.seed
        assert config.receiver
        if self._receiver is None or self._receiver.seed != seed:
            self._receiver = Receiver(config, config.receiver, seed)
        ring = self._pattern.ring[cast.rays]
        hiss = white(seed, f"{config.name}/echo", stamp_ns, config.rays)
        drawn = np.stack([noise[cast.rays], hiss[cast.rays]])
        range_m, measured = self._receiver.measure(ring, cast.hits, cast.share, cast.relief_m, drawn)
        # Weather has decided on intensities already.
        seen = np.rint(intensity) if config.weather else measured
        return dataclasses.replace(cast.hits, range_m=range_m), seen

    def _in_weather(
        self, timeline: Timeline, stamp_ns: int, cast: Cast, weather: WeatherParameters
    ) -> tuple[Cast, F32]:
        """Rays, what they return under a weather, and how strongly."""
        config, rays, hits = self.config, cast.rays, cast.hits
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
        return Cast(
            rays=rays[seen], hits=found, share=cast.share[seen], relief_m=cast.relief_m[seen]
        ), intensity
