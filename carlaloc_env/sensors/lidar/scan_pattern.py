"""Scan pattern of a LiDAR: directions and times of the rays of one revolution, and their hits."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary, transforms
from carlaloc_env.core.array_types import F32, Array, Index
from carlaloc_env.raycast import Hits
from carlaloc_env.sensors.base import World
from carlaloc_env.sensors.lidar.beam_divergence import sub_rays, weigh
from carlaloc_env.sensors.lidar.kernels import ColumnMotion, PatternRays, aim
from carlaloc_env.timeline.timeline import Timeline

if TYPE_CHECKING:
    from carlaloc_env.sensors.lidar.config import LidarConfig


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
