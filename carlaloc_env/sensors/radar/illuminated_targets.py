"""Illuminated targets of a radar: echoes of scenery and road users that rays find, and mirror images."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import clock, elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.raycast import Hits
from carlaloc_env.sensors.base import World
from carlaloc_env.sensors.ground_truth.bounding_boxes import ActorBoxes, boxes_at
from carlaloc_env.sensors.radar.angles import direction, dot, into, out_of, polar
from carlaloc_env.sensors.radar.cross_sections import actor_rcs_dbsm, scenery_db, texture
from carlaloc_env.sensors.radar.multipath import mirror_images
from carlaloc_env.sensors.radar.radar_equation import RadarEchoes
from carlaloc_env.timeline.ego_spline import Motion
from carlaloc_env.timeline.timeline import Timeline

if TYPE_CHECKING:
    from carlaloc_env.sensors.radar.config import RadarConfig


class RadarView:
    """View of one radar; each ray stands for a part of a radar cross-section."""

    def __init__(self, config: RadarConfig, world: World) -> None:
        self._config, self._world = config, world
        self._half = config.half_fov_rad

    def echoes(
        self, timeline: Timeline, stamp_ns: int, motion: Motion
    ) -> tuple[RadarEchoes, RadarEchoes, RadarEchoes]:
        """Echoes of scenery, of actors, and of their mirror images.

        Args:
            timeline: Where everything is.
            stamp_ns: Time of the frame [ns].
            motion: Motion of the radar then.
        """
        config = self._config
        boxes = self._near(boxes_at(timeline, stamp_ns), motion)
        generator = clock.stream(self._world.seed, f"{config.frame_id}/rays", stamp_ns)
        grid = self._grid(generator)
        aimed_at = np.repeat(np.arange(len(boxes)), config.rays_per_actor)
        inside = (generator.random((len(aimed_at), 3)) - 0.5) * 0.9 * boxes.size_m[aimed_at]
        origin = motion.position_m[0]
        towards = boxes.to_world(aimed_at, inside) - origin
        aimed_m = np.maximum(np.sqrt(np.sum(towards * towards, axis=-1)), 1e-6)
        directions = np.concatenate([out_of(motion, grid), towards / aimed_m[:, None]])

        def cast(origins_m: Array, along: Array) -> Hits:
            stamps = np.full(len(along), stamp_ns, dtype=np.int64)
            return self._world.rays().cast(origins_m, along, stamps, timeline, config.range_max_m, ego=False)

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

    def _near(self, boxes: ActorBoxes, motion: Motion) -> ActorBoxes:
        """Boxes of which a part may be in view."""
        local = into(motion, boxes.centre_m - motion.position_m[0])
        distance, azimuth, elevation = polar(local)
        radius = 0.5 * np.sqrt(np.sum(boxes.size_m * boxes.size_m, axis=-1))
        beside = elementary.arcsin(np.minimum(radius / np.maximum(distance, 1e-3), 1.0))
        slack = np.where(distance > radius, beside, np.pi)
        seen = distance - radius < self._config.range_max_m
        seen &= (np.abs(azimuth) < self._half[0] + slack) & (np.abs(elevation) < self._half[1] + slack)
        return boxes.take(np.flatnonzero(seen))

    def _grid(self, generator: np.random.Generator) -> Array:
        """Directions over the field of view, one in every part of an even grid, sensor frame (M, 3)."""
        columns, rows = self._config.columns, self._config.rows
        uniform = generator.random((rows, columns, 2))
        azimuth = ((np.arange(columns) + uniform[..., 0]) / columns * 2 - 1) * self._half[0]
        elevation = ((np.arange(rows)[:, None] + uniform[..., 1]) / rows * 2 - 1) * self._half[1]
        return direction(azimuth, elevation).reshape(-1, 3)

    def _scenery(self, hits: Hits, directions: Array, local: Array, motion: Motion) -> RadarEchoes:
        """Each ray stands for the projected area R²·dΩ, whose cross-section is γ times as large."""
        distance, azimuth, elevation = polar(local * hits.range_m[:, None].astype(np.float64))
        solid = 4 * self._half[0] * self._half[1] / (self._config.columns * self._config.rows)
        area = distance * distance * solid * elementary.cos(elevation)
        strength = texture(motion.position_m[0] + distance[:, None] * directions)
        return RadarEchoes(
            range_m=distance,
            azimuth_rad=azimuth,
            elevation_rad=elevation,
            doppler_mps=-dot(directions, motion.velocity_world_mps[0]),
            rcs_m2=area * strength * elementary.power(10.0, 0.1 * scenery_db(hits.tag, hits.cos_incidence)),
            tag=hits.tag,
            instance=hits.instance,
        )

    def _actors(
        self,
        hits: Hits,
        directions: Array,
        aimed_at: NDArray[np.intp],
        aimed_m: Array,
        boxes: ActorBoxes,
        motion: Motion,
    ) -> tuple[RadarEchoes, NDArray[np.intp]]:
        """Each ray that meets its actor carries an even part of the cross-section of what is visible.

        Rays that pass the actor do not count; those that another thing stops take their part away.
        """
        met = hits.instance == boxes.id[aimed_at]
        stopped = ~met & (hits.range_m < aimed_m - 1.0)
        counted = np.bincount(aimed_at[met | stopped], minlength=len(boxes))
        rows = np.flatnonzero(met)
        of_box = aimed_at[rows]
        distance = hits.range_m[rows].astype(np.float64)
        along = directions[rows]
        points = motion.position_m[0] + distance[:, None] * along
        _, azimuth, elevation = polar(into(motion, along))
        to_radar = motion.position_m[0] - boxes.centre_m
        aspect = elementary.arctan2(to_radar[:, 1], to_radar[:, 0]) - boxes.heading_rad
        whole = elementary.power(10.0, 0.1 * actor_rcs_dbsm(boxes.tag, aspect))
        closing = boxes.velocity_at(of_box, points) - motion.velocity_world_mps[0]
        echoes = RadarEchoes(
            range_m=distance,
            azimuth_rad=azimuth,
            elevation_rad=elevation,
            doppler_mps=dot(along, closing),
            rcs_m2=whole[of_box] / np.maximum(counted[of_box], 1),
            tag=boxes.tag[of_box],
            instance=boxes.id[of_box],
        )
        return echoes, of_box

    def _in_view(self, echoes: RadarEchoes) -> RadarEchoes:
        inside = np.abs(echoes.azimuth_rad) <= self._half[0]
        inside &= np.abs(echoes.elevation_rad) <= self._half[1]
        return echoes.take(np.flatnonzero(inside))
