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
from carlaloc_env.sensors.lidar.optics import pattern_directions
from carlaloc_env.sensors.lidar_config import LidarConfig

_KNOT_NS = 1e5
"""Least time between readings of the car's motion where sweeps differ [ns]; it moves on by 0.1 µm at most
besides constant velocity and rate, seen at 100 m."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SweepRays:
    """Rays of one sweep, R of them column by column; those of one column in the order of firing."""

    knot_ns: NDArray[np.int64]
    """Times after the sweep began at which the car's motion is read [ns], shape (K,)."""
    knot: Index
    """The last of these times before each ray, shape (R,)."""
    later_s: Array
    """Time of each ray after its knot [s], shape (R,)."""
    ring: NDArray[np.uint16]
    """Beam of each ray as clouds number it, shape (R,)."""
    offset_ns: NDArray[np.uint32]
    """Time of each ray after the sweep began [ns], shape (R,)."""
    directions: Array
    """Unit directions in the sensor frame before the turn, shape (R, 3)."""
    origins_m: Array
    """Where rays begin there [m], shape (R, 3); (0, 3): at its origin."""
    turn: tuple[float, float]
    """Cosine and sine of the turn of this sweep about the sensor's z axis."""
    R_base: Array
    """Maps directions before the turn to `base_link`, shape (3, 3)."""

    def __len__(self) -> int:
        return len(self.knot)

    def turned(self, vectors: Array) -> Array:
        """Some of `directions` or `origins_m` after the turn: in the sensor frame, shape (N, 3)."""
        return rotated(_about_z(self.turn), vectors)


class RayPattern:
    """Rays of every sweep of one LiDAR."""

    def __init__(self, config: LidarConfig) -> None:
        self._config = config
        self._columns = config.columns_per_sweep
        self._R_base_lidar = config.mount.T_base_sensor[:3, :3]
        self.is_constant = config.pattern is None and self._columns.denominator == 1
        """Whether all sweeps have the same rays."""
        column_ns = config.sweep_ns / float(self._columns)
        self._per_knot = 1 if self.is_constant else math.ceil(_KNOT_NS / column_ns)
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
        knot, knot_ns = columns // self._per_knot, column_ns[:: self._per_knot]
        later_ns = (column_ns - knot_ns[knot])[:, None] + firing_ns
        ring = (config.rings - 1 - self._order) if config.rings_from_top else self._order
        directions, origins_m = self._beams(columns)
        return SweepRays(
            knot_ns=knot_ns,
            knot=np.repeat(knot, config.rings),
            later_s=1e-9 * later_ns.reshape(-1).astype(np.float64),
            ring=np.tile(ring.astype(np.uint16), config.columns_most),
            offset_ns=(column_ns[:, None] + firing_ns).reshape(-1).astype(np.uint32),
            directions=directions,
            origins_m=origins_m,
            turn=(1.0, 0.0),
            R_base=self._R_base_lidar,
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
        turn = float(elementary.cos(angle_rad)), float(elementary.sin(angle_rad))
        kept = slice(count * config.rings)
        some = ("knot", "later_s", "ring", "directions", "origins_m")
        return replace(
            first,
            **{name: getattr(first, name)[kept] for name in some},
            knot_ns=first.knot_ns[: -(-count // self._per_knot)] + late_ns,
            offset_ns=first.offset_ns[kept] + np.uint32(late_ns),
            turn=turn,
            R_base=rotated(self._R_base_lidar, _about_z(turn).T).T,
        )

    def _bent(self, stamp_ns: int, seed: int) -> SweepRays:
        """Rays of a pattern from a stamp on [ns]; all lines of a column share the state of the optics."""
        begun_ns = self._first.offset_ns[:: self._config.rings].astype(np.int64)
        time_s = 1e-9 * (stamp_ns + begun_ns).astype(np.float64)
        directions = pattern_directions(self._config, seed, self._order, time_s)
        return replace(self._first, directions=directions)


def rotated(R: Array, vectors: Array) -> Array:
    """N vectors turned by a rotation (3, 3), shape (N, 3)."""
    return transforms.apply(transforms.from_rotation(R), vectors)


def _about_z(turn: tuple[float, float]) -> Array:
    cosine, sine = turn
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
