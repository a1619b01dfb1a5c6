"""The car's own body as a LiDAR on it meets it: body and LiDAR are rigid, so that little need be cast."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.assets.vehicles.roof_rack import roof_rack
from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.jit import compiled
from carlaloc_env.raycast import Hits
from carlaloc_env.sensors.base import World
from carlaloc_env.sensors.lidar.sweep_rays import SweepRays, rotated
from carlaloc_env.sensors.lidar_config import LidarConfig

_TALL, _WIDE = 230, 720
"""Cells of directions that are searched once for the body, about 0.5° in size: by height, and all round."""
_ROUND = 3
"""Cells around one that meets the body in which rays are cast: 1.5° for edges and origins off the axis."""


class OwnBody:
    """Own body, and the rack on its roof, in the rays of a LiDAR."""

    def __init__(self, config: LidarConfig, world: World, *, is_constant: bool) -> None:
        self._config, self._world = config, world
        self._is_constant = is_constant
        self._kept: tuple[Hits, Index] | None = None

    def hits(self, rays: SweepRays) -> tuple[Hits, Index]:
        """Hits on the body of all rays of a sweep, and the rays that pass it."""
        if self._kept is not None:
            return self._kept
        near: Index | slice = slice(None)
        if not self._is_constant:
            is_near = np.empty(len(rays), np.bool_)
            _look_up(rays.directions, rays.turn, self._near, is_near)
            near = np.flatnonzero(is_near)
        hits, origins_m = Hits.none(len(rays)), rays.origins_m
        if len(origins_m):
            origins_m = rotated(rays.R_base, origins_m[near])
        hits.put(near, self._cast(origins_m, rotated(rays.R_base, rays.directions[near])))
        found = hits, np.flatnonzero(~np.isfinite(hits.range_m))
        self._kept = found if self._is_constant else None
        return found

    def _cast(self, origins_m: Array, directions: Array) -> Hits:
        """Hits of rays from places counted from the sensor in `base_link`, (0, 3): from itself."""
        config = self._config
        origins_m = config.mount.T_base_sensor[:3, 3] + (origins_m if len(origins_m) else 0.0 * directions)
        rack = roof_rack() if config.roof_rack else None
        return self._world.rays().cast_ego(origins_m, directions, config.range_max_m, rack)

    @cached_property
    def _near(self) -> NDArray[np.bool_]:
        """Whether the body lies in each cell of directions or close by, shape (_TALL, _WIDE)."""
        up = (np.arange(_TALL) + 0.5) * 2.0 / _TALL - 1.0
        around = (np.arange(_WIDE) + 0.5) * 4.0 / _WIDE - 1.0
        left = np.where(around < 1.0, around, 2.0 - around)
        ahead = np.where(around < 1.0, 1.0, -1.0) * (1.0 - np.abs(left))
        flat = np.sqrt(1.0 - up * up)[:, None] / np.sqrt(ahead * ahead + left * left)
        local = np.stack([flat * ahead, flat * left, np.broadcast_to(up[:, None], flat.shape)], axis=-1)
        R_base_lidar = self._config.mount.T_base_sensor[:3, :3]
        hits = self._cast(np.empty((0, 3)), rotated(R_base_lidar, local.reshape(-1, 3)))
        near = np.isfinite(hits.range_m).reshape(_TALL, _WIDE)
        for axis in (0, 1):
            near = np.any([np.roll(near, k, axis) for k in range(-_ROUND, _ROUND + 1)], axis=0)
        return near


@compiled
def _look_up(
    directions: Array, turn: tuple[float, float], cells: NDArray[np.bool_], out: NDArray[np.bool_]
) -> None:
    """Cells of N unit directions: rows by height, columns by the angle around in parts of a square's edge."""
    cosine, sine = turn
    for i in range(len(directions)):
        x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
        x, y = cosine * x - sine * y, sine * x + cosine * y
        left = y / max(abs(x) + abs(y), 1e-12)
        around = left if x >= 0.0 else 2.0 - left
        row = min(int(0.5 * _TALL * (z + 1.0)), _TALL - 1)
        out[i] = cells[row, min(int(0.25 * _WIDE * (around + 1.0)), _WIDE - 1)]
