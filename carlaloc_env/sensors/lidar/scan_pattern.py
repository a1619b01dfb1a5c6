"""Scan pattern of a spinning LiDAR: directions, times and first hits of the rays of one revolution.

A beam that diverges is several rays, whose energies make one echo. With a receiver, only beams on edges are
cast in parts.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.assets.vehicles.roof_rack import roof_rack
from carlaloc_env.core import elementary, transforms
from carlaloc_env.core.array_types import F32, Array, Index
from carlaloc_env.raycast import Hits
from carlaloc_env.sensors.base import World
from carlaloc_env.sensors.lidar.beams import on_edges, part_beams, sub_rays, weigh
from carlaloc_env.sensors.lidar.kernels import (
    ColumnMotion,
    PatternRays,
    aim,
)
from carlaloc_env.sensors.lidar.receiver import ground_relief
from carlaloc_env.sensors.lidar.surface_details import surface_details
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.timeline.timeline import Timeline


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
        columns = np.arange(config.columns_most)
        firing = np.array(config.firing_ns or [0] * len(config.elevations_deg), dtype=np.int64)
        order = np.argsort(firing, kind="stable")
        self._firing_ns = firing[order]
        self._column_ns = np.round(columns * config.sweep_ns / config.columns_most).astype(np.int64)
        self._column = np.repeat(columns, len(firing))
        self.ring = np.tile(order.astype(np.uint16), config.columns_most)
        self.directions = self._make_directions(order)
        self._directions_base = transforms.apply(
            transforms.from_rotation(self._T_base_lidar[:3, :3]), self.directions
        )
        if config.sectors:
            self._column_ns = (
                columns * config.sectors // config.columns_most * config.sweep_ns // config.sectors
            )
            self._firing_ns = np.zeros_like(self._firing_ns)
        self._later_s = np.tile(1e-9 * self._firing_ns, config.columns_most)
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
        free_hits = world.trace(aimed, stamps_ns, timeline, config.range_max_m)
        if config.receiver:
            if config.receiver.edge_rays:
                range_m, material = body.range_m.copy(), body.material.copy()
                range_m[free], material[free] = free_hits.range_m, free_hits.material
                edges = np.flatnonzero(on_edges(range_m, material, config.columns_most)[free])
                along = part_beams(aimed[edges, 3:].astype(np.float64), config.receiver)
                mixed, share[free[edges]] = self._mixed(
                    free_hits.take(edges), aimed[edges], along, stamps_ns[edges], timeline, power
                )
                free_hits.put(edges, mixed)
            if config.receiver.relief:
                rows, coat, height_m = surface_details(aimed, free_hits, world.middle_m)
                share[free[rows]] *= coat
                if self._world.roughness is not None:
                    place = (*world.middle_m[:2].tolist(), 1e-3 * config.receiver.beam_mrad[1])
                    relief_m[free] = ground_relief(aimed, free_hits, self._world.roughness, place)
                relief_m[free[rows]] += height_m
        elif config.divergence_mrad:
            along = sub_rays(aimed[:, 3:].astype(np.float64), 1e-3 * config.divergence_mrad)
            free_hits, _ = self._mixed(free_hits, aimed, along, stamps_ns, timeline, power)
        if not config.ego_returns:
            return Cast(rays=free, hits=free_hits, share=share[free], relief_m=relief_m[free])
        hits = dataclasses.replace(body, **{name: getattr(body, name).copy() for name in body.__slots__})
        hits.put(free, free_hits)
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
        """Hits of beams of several rays, as `weigh` gives them.

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
        columns = (np.arange(config.columns_most)[:, None] + 0.5) / config.columns
        azimuth = math.pi - 2 * math.pi * (columns + self._firing_ns / config.sweep_ns)
        flat = elementary.cos(elevation)
        up = np.broadcast_to(elementary.sin(elevation), azimuth.shape)
        along: Array = np.stack([flat * elementary.cos(azimuth), flat * elementary.sin(azimuth), up], axis=-1)
        return along.reshape(-1, 3)
