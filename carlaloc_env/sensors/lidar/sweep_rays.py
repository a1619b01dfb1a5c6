"""Rays of one sweep in the order of their time: beams of turning columns, or lines of a pattern.

Where a sweep holds no whole number of columns, the next one goes on where it ended, and its rays are turned
by a part of a column. Those of a pattern differ in every sweep.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary, transforms
from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.jit import compiled
from carlaloc_env.sensors.lidar.optics import pattern_directions
from carlaloc_env.sensors.lidar_config import LidarConfig


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SweepRays:
    """Rays of one sweep, R of them in C columns; those of one column in the order of firing."""

    column_ns: NDArray[np.int64]
    """Time of each column after the sweep began [ns], shape (C,)."""
    column: Index
    """Column of each ray, shape (R,)."""
    later_s: Array
    """Time of each ray after its column began [s], shape (R,)."""
    ring: NDArray[np.uint16]
    """Beam of each ray as clouds number it, shape (R,)."""
    offset_ns: NDArray[np.uint32]
    """Time of each ray after the sweep began [ns], shape (R,)."""
    directions: Array
    """Unit directions in the sensor frame, shape (R, 3)."""
    origins_m: Array
    """Where rays begin in the sensor frame [m], shape (R, 3); (0, 3): at its origin."""
    directions_base: Array
    """Unit directions in `base_link`, shape (R, 3)."""
    origins_base_m: Array
    """Where rays begin in `base_link` [m], shape (R, 3) or (0, 3)."""

    def __len__(self) -> int:
        return len(self.column)


class RayPattern:
    """Rays of every sweep of one LiDAR."""

    def __init__(self, config: LidarConfig) -> None:
        self._config = config
        self._columns = config.columns_per_sweep
        self._T_base_lidar = config.mount.T_base_sensor
        self.is_constant = config.pattern is None and self._columns.denominator == 1
        """Whether all sweeps have the same rays."""
        firing = np.array(config.firing_ns or [0] * config.rings, dtype=np.int64)
        self._order = np.argsort(firing, kind="stable")
        self._firing_ns = firing[self._order]
        self._first = self._first_sweep()

    def sweep(self, stamp_ns: int, seed: int) -> SweepRays:
        """Rays of the sweep that begins at a stamp [ns]; the seed counts for patterns alone."""
        if self.is_constant:
            return self._first
        if self._config.pattern is not None:
            return self._bent(stamp_ns, seed)
        begun = Fraction(stamp_ns) * self._columns / self._config.sweep_ns
        return self._turned(float(math.ceil(begun) - begun))

    def _first_sweep(self) -> SweepRays:
        """Rays of a sweep whose first column begins with it; those of a pattern are not bent yet."""
        config = self._config
        columns = np.arange(config.columns_most)
        column_ns = np.round(columns * config.sweep_ns / float(self._columns)).astype(np.int64)
        firing_ns = self._firing_ns
        if config.sectors:
            column_ns = columns * config.sectors // config.columns * config.sweep_ns // config.sectors
            firing_ns = np.zeros_like(firing_ns)
        ring = (config.rings - 1 - self._order) if config.rings_from_top else self._order
        directions, origins_m = self._beams(columns)
        return SweepRays(
            column_ns=column_ns,
            column=np.repeat(columns, config.rings),
            later_s=np.tile(1e-9 * firing_ns, config.columns_most),
            ring=np.tile(ring.astype(np.uint16), config.columns_most),
            offset_ns=(column_ns[:, None] + firing_ns).reshape(-1).astype(np.uint32),
            directions=directions,
            origins_m=origins_m,
            directions_base=transforms.apply(
                transforms.from_rotation(self._T_base_lidar[:3, :3]), directions
            ),
            origins_base_m=transforms.apply(self._T_base_lidar, origins_m),
        )

    def _beams(self, columns: Index) -> tuple[Array, Array]:
        """Unit directions and origins [m] of all rays in the sensor frame, (R, 3) each."""
        config, order = self._config, self._order
        elevation = np.radians(np.array(config.elevations_deg)[order] + config.elevation_offset_deg)
        span_rad = math.radians(config.span_deg)
        passed = (columns[:, None] + 0.5) / float(self._columns) + self._firing_ns / config.sweep_ns
        turned = 0.5 * span_rad - span_rad * passed
        azimuth = turned + np.radians(np.array(config.azimuth_offsets_deg or [0.0] * config.rings))[order]
        flat = elementary.cos(elevation)
        up = np.broadcast_to(elementary.sin(elevation), azimuth.shape)
        along = np.stack([flat * elementary.cos(azimuth), flat * elementary.sin(azimuth), up], axis=-1)
        if not config.origins_m:
            return along.reshape(-1, 3), np.empty((0, 3))
        places = np.broadcast_to(np.array(config.origins_m), (config.rings, 3))[order]
        ahead, left, above = (np.broadcast_to(places[:, k], turned.shape) for k in range(3))
        cosine, sine = elementary.cos(turned), elementary.sin(turned)
        origins = np.stack([ahead * cosine - left * sine, ahead * sine + left * cosine, above], axis=-1)
        return along.reshape(-1, 3), origins.reshape(-1, 3)

    def _turned(self, waits: float) -> SweepRays:
        """Rays of a sweep whose first column begins a part of a column after it."""
        config, first = self._config, self._first
        columns, late_ns = float(self._columns), round(waits * config.sweep_ns / float(self._columns))
        count = math.ceil(columns - waits)
        angle_rad = -math.radians(config.span_deg) * waits / columns
        cosine, sine = float(elementary.cos(angle_rad)), float(elementary.sin(angle_rad))
        turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        rays = slice(count * config.rings)
        origins_m = np.empty_like(first.origins_m[rays])
        _carry(turn, np.zeros(3), first.origins_m[rays], origins_m)
        same = {name: getattr(first, name)[rays] for name in ("column", "later_s", "ring")}
        column_ns, offset_ns = first.column_ns[:count] + late_ns, first.offset_ns[rays] + np.uint32(late_ns)
        turned = replace(first, column_ns=column_ns, offset_ns=offset_ns, origins_m=origins_m, **same)
        return self._aimed(turned, turn, first.directions[rays])

    def _bent(self, stamp_ns: int, seed: int) -> SweepRays:
        """Rays of a pattern from a stamp on [ns]."""
        time_s = 1e-9 * (stamp_ns + self._first.offset_ns.astype(np.int64))
        line = np.tile(self._order, self._config.columns_most)
        return self._aimed(self._first, np.eye(3), pattern_directions(self._config, seed, line, time_s))

    def _aimed(self, rays: SweepRays, turn: Array, directions: Array) -> SweepRays:
        """Rays along directions (R, 3) that are turned by a matrix first."""
        local, base = np.empty_like(directions), np.empty_like(directions)
        origins_base_m = np.empty_like(rays.origins_m)
        T = self._T_base_lidar
        _carry(turn, np.zeros(3), directions, local)
        _carry(np.ascontiguousarray(T[:3, :3]), np.zeros(3), local, base)
        _carry(np.ascontiguousarray(T[:3, :3]), T[:3, 3].copy(), rays.origins_m, origins_base_m)
        return replace(rays, directions=local, directions_base=base, origins_base_m=origins_base_m)


@compiled
def _carry(turn: Array, by: Array, vectors: Array, out: Array) -> None:
    """Turn N vectors by a matrix and move them, shape (N, 3)."""
    for i in range(len(vectors)):
        x, y, z = vectors[i, 0], vectors[i, 1], vectors[i, 2]
        for k in range(3):
            out[i, k] = turn[k, 0] * x + turn[k, 1] * y + turn[k, 2] * z + by[k]
