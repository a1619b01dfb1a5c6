"""First hits of the rays of one sweep.

A beam that diverges is several rays, whose energies make one echo. With a receiver, only beams on edges are
cast in parts.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32, Array, Index
from carlaloc_env.raycast import Hits
from carlaloc_env.sensors.base import World
from carlaloc_env.sensors.lidar.beams import on_edges, part_beams, sub_rays, weigh
from carlaloc_env.sensors.lidar.kernels import (
    ColumnMotion,
    PatternRays,
    aim,
)
from carlaloc_env.sensors.lidar.own_body import OwnBody
from carlaloc_env.sensors.lidar.receiver import ground_relief
from carlaloc_env.sensors.lidar.surface_details import surface_details
from carlaloc_env.sensors.lidar.sweep_rays import RayPattern, SweepRays
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.timeline.timeline import Timeline


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cast:
    """Rays of a scan that may return something, M of them, and what they meet."""

    rays: Index
    """Numbers of the rays, shape (M,)."""
    sweep: SweepRays
    """All rays of the sweep."""
    hits: Hits
    """First hits, shape (M,)."""
    share: F32
    """Energy that each hit returns over that of a whole beam on its material, shape (M,)."""
    relief_m: F32
    """Height of the surface above its mesh at each hit [m], shape (M,)."""


class ScanPattern:
    """Casts the rays of one LiDAR."""

    def __init__(self, config: LidarConfig, world: World) -> None:
        self._config, self._world = config, world
        self.rays = RayPattern(config)
        """Rays of every sweep."""
        self._lever_m = config.mount.T_base_sensor[:3, 3]
        self._body = OwnBody(config, world, is_constant=self.rays.is_constant)

    def cast(self, timeline: Timeline, stamp_ns: int, power: Callable[[Hits], Array]) -> Cast:
        """Rays that may return something in a scan, and their first hits.

        Args:
            timeline: Where everything is.
            stamp_ns: When the sweep begins [ns].
            power: Strength of echoes, for beams of more than one ray.
        """
        config = self._config
        sweep = self.rays.sweep(stamp_ns, self._world.seed)
        body, free = self._body.hits(sweep)
        world, aimed = self._world.rays(), self.aimed(timeline, stamp_ns, sweep, free)
        stamps_ns = stamp_ns + self.after_ns(sweep, free)
        share, relief_m = np.ones(len(sweep), np.float32), np.zeros(len(sweep), np.float32)
        free_hits = world.trace(aimed, stamps_ns, timeline, config.range_max_m)
        if config.receiver:
            if config.receiver.edge_rays:
                range_m, material = body.range_m.copy(), body.material.copy()
                range_m[free], material[free] = free_hits.range_m, free_hits.material
                edges = np.flatnonzero(on_edges(range_m, material, len(sweep) // config.rings)[free])
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
            return Cast(rays=free, sweep=sweep, hits=free_hits, share=share[free], relief_m=relief_m[free])
        hits = dataclasses.replace(body, **{name: getattr(body, name).copy() for name in body.__slots__})
        hits.put(free, free_hits)
        return Cast(rays=np.arange(len(sweep)), sweep=sweep, hits=hits, share=share, relief_m=relief_m)

    def after_ns(self, sweep: SweepRays, rays: Index) -> NDArray[np.int64]:
        """Times of some rays after the sweep began at which road users are looked up [ns], shape (N,).

        The last column may outlast the sweep, beyond which nothing is known yet of a drive under way.
        """
        return np.minimum(sweep.offset_ns[rays], self._config.sweep_ns).astype(np.int64)

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

    def aimed(self, timeline: Timeline, stamp_ns: int, sweep: SweepRays, rays: Index) -> F32:
        """Some rays of a sweep at their own times, as `RayScene.trace` takes them, shape (N, 6).

        Poses are read at the start of each column; within its few microseconds the motion is
        continued with constant velocity and rate, which is exact to a nanometre.
        """
        motion = timeline.ego_motion(stamp_ns + sweep.knot_ns)
        aimed = np.empty((len(rays), 6), np.float32)
        aim(
            rays,
            PatternRays(sweep.knot, sweep.later_s, sweep.directions, sweep.origins_m, sweep.R_base),
            self._lever_m,
            ColumnMotion(
                position_m=motion.position_m - self._world.rays().middle_m,
                quat_xyzw=motion.quat_xyzw,
                velocity_mps=motion.velocity_world_mps,
                omega_radps=motion.omega_body_radps,
            ),
            aimed,
        )
        return aimed
