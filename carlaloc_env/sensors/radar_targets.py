"""Illuminated targets of a radar: echoes of scenery and road users that rays find, and mirror images.

Ghosts: mirror images of road users in walls, rails and the road (multipath of even order).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import clock, elementary, transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.raycast import Hits
from carlaloc_env.sensors.actor_boxes import ActorBoxes, boxes_at
from carlaloc_env.sensors.base import World
from carlaloc_env.sensors.radar_cross_sections import (
    REFLECTORS,
    actor_rcs_dbsm,
    scenery_db,
    texture,
)
from carlaloc_env.sensors.radar_directions import (
    direction,
    dot,
    into,
    out_of,
    polar,
)
from carlaloc_env.sensors.radar_equation import RadarEchoes
from carlaloc_env.timeline.motion import Motion
from carlaloc_env.timeline.timeline import Timeline

if TYPE_CHECKING:
    from carlaloc_env.sensors.radar_config import RadarConfig

Cast = Callable[[Array, Array], Hits]
"""First hits of rays given by origins [m] and unit directions, world, each (M, 3)."""

GHOST_RANGE_M = 60.0
"""Targets and mirrors farther away give no ghosts worth keeping [m]."""
ROAD_EXTRA_LOSS_DB = 5.0
"""What the road's reflection loses beyond a wall's, each way [dB]."""
_PAIRS = 64
"""Pairs of scatterer and mirror tried per frame."""
_PLANE_SLACK_M = 0.3
"""Distance from a mirror's plane within which its ray must meet it [m]."""


def mirror_images(
    actors: RadarEchoes,
    of_box: NDArray[np.intp],
    boxes: ActorBoxes,
    hits: Hits,
    directions: Array,
    motion: Motion,
    cast: Cast,
    *,
    loss_db: float,
    generator: np.random.Generator,
) -> RadarEchoes:
    """Echoes along radar → mirror → target → mirror → radar: they seem to come from behind the mirror.

    A ghost lies at the target's image p' = p − 2((p − w)·n)n, with the Doppler of the image, and is
    weaker by twice the reflection's loss (Kraus et al., "Using machine learning to detect ghost
    images in automotive radar", ITSC 2020, call it type-2 second bounce). It exists only where the
    mirror really stands on the line to the image, and the target is in view of that point.

    Args:
        actors: Echoes of road users.
        of_box: Box of each echo, shape (N,).
        boxes: Road users in view.
        hits: Scenery that was met.
        directions: Direction of each of these hits, world, shape (M, 3).
        motion: Motion of the radar.
        cast: Finds first hits.
        loss_db: Loss of a reflection by a wall, each way [dB].
        generator: Chooses the pairs that are tried.
    """
    origin = motion.position_m[0]
    choice = generator.random((2, _PAIRS))
    walls = np.flatnonzero(np.isin(hits.tag, REFLECTORS) & (hits.range_m < GHOST_RANGE_M))
    near = np.flatnonzero(actors.range_m < GHOST_RANGE_M)
    if len(near) == 0:
        return actors.take(near)
    target = near[(choice[0] * len(near)).astype(np.intp)]
    points = origin + actors.range_m[target, None] * out_of(
        motion, direction(actors.azimuth_rad[target], actors.elevation_rad[target])
    )
    on_wall, normal, loss = _mirrors(hits, directions, walls, choice[1], motion, cast, loss_db)
    off = dot(points - on_wall, normal)
    image = points - 2.0 * off[:, None] * normal
    towards = image - origin
    far = np.sqrt(dot(towards, towards))
    along = towards / np.maximum(far, 1e-6)[:, None]
    facing = dot(along, normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        mirror_m = dot(on_wall - origin, normal) / facing
    possible = np.isfinite(mirror_m) & (mirror_m > 0.5) & (mirror_m < far)
    possible &= off * dot(origin - on_wall, normal) > 0
    rows = np.flatnonzero(possible)
    rows = rows[np.abs(cast(np.broadcast_to(origin, (len(rows), 3)), along[rows]).range_m - mirror_m[rows])
                < _PLANE_SLACK_M]  # fmt: skip
    bounce = origin + mirror_m[rows, None] * along[rows] - 0.05 * along[rows]
    onward = points[rows] - bounce
    length = np.maximum(np.sqrt(dot(onward, onward)), 1e-6)
    met = cast(bounce, onward / length[:, None])
    rows = rows[met.instance == actors.instance[target[rows]]]
    return _images(actors, target[rows], of_box, boxes, points[rows], image[rows], normal[rows], motion,
                   loss[rows])  # fmt: skip


def _mirrors(
    hits: Hits,
    directions: Array,
    walls: NDArray[np.intp],
    choice: Array,
    motion: Motion,
    cast: Cast,
    loss_db: float,
) -> tuple[Array, Array, Array]:
    """A point, the normal and the loss each way [dB] of a mirror for every pair.

    Every fourth mirror is the road below the radar. The normal of a wall comes from two more rays
    beside the one that met it.
    """
    origin = motion.position_m[0]
    up = out_of(motion, np.array([[0.0, 0.0, 1.0]]))[0]
    count = len(choice)
    road = np.arange(count) % 4 == 0
    below = cast(origin[None], -up[None]).range_m[0]
    road &= bool(np.isfinite(below))
    along = np.broadcast_to(up, (count, 3))
    if len(walls):
        along = directions[walls[np.minimum((choice * len(walls)).astype(np.intp), len(walls) - 1)]]
    sideways = transforms.cross(along, np.broadcast_to(up, along.shape))
    above = transforms.cross(sideways, along)
    rays = np.concatenate([along + 0.01 * sideways, along + 0.01 * above, along])
    rays = rays / np.sqrt(dot(rays, rays))[:, None]
    ranges = cast(np.broadcast_to(origin, rays.shape), rays).range_m.astype(np.float64)
    with np.errstate(invalid="ignore"):  # rays into the sky have no end, and their mirrors none either
        ends = (origin + ranges[:, None] * rays).reshape(3, count, 3)
        normal = transforms.cross(ends[0] - ends[2], ends[1] - ends[2])
        size = np.sqrt(dot(normal, normal))
        normal = normal / size[:, None]
    if not len(walls):
        normal[:] = np.nan
    normal[road] = up
    points = ends[2]
    points[road] = origin - below * up if np.isfinite(below) else np.nan
    return points, normal, np.where(road, loss_db + ROAD_EXTRA_LOSS_DB, loss_db)


def _images(
    actors: RadarEchoes,
    target: NDArray[np.intp],
    of_box: NDArray[np.intp],
    boxes: ActorBoxes,
    points: Array,
    image: Array,
    normal: Array,
    motion: Motion,
    loss_db: Array,
) -> RadarEchoes:
    velocity = boxes.velocity_at(of_box[target], points)
    mirrored = velocity - 2.0 * dot(velocity, normal)[:, None] * normal
    towards = image - motion.position_m[0]
    distance = np.sqrt(dot(towards, towards))
    along = towards / np.maximum(distance, 1e-6)[:, None]
    _, azimuth, elevation = polar(into(motion, along))
    return RadarEchoes(
        range_m=distance,
        azimuth_rad=azimuth,
        elevation_rad=elevation,
        doppler_mps=dot(along, mirrored - motion.velocity_world_mps[0]),
        rcs_m2=actors.rcs_m2[target] * elementary.power(10.0, -0.2 * loss_db),
        tag=actors.tag[target],
        instance=actors.instance[target],
    )


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
