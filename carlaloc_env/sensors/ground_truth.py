"""The truth: the ego's motion, and boxes and visibility of all other road users."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.transforms import quat_rotate
from carlaloc_env.samples import ObjectList, Odometry
from carlaloc_env.timeline.timeline import Timeline

if TYPE_CHECKING:
    from carlaloc_env.raycast import RayScene
from carlaloc_env.sensors.actor_boxes import ActorBoxes, boxes_at

VISIBILITY_RANGE_M = 120.0
"""Distance within which visibility is measured [m]."""
_RAYS = 40
"""Rays aimed at each object."""


def objects_at(
    timeline: Timeline,
    stamp_ns: int,
    *,
    rays: RayScene | None = None,
    eye_m: tuple[float, float, float] = (1.2, 0.0, 1.85),
) -> ObjectList:
    """All actors at one time; their ids are those of points and pixels.

    Args:
        timeline: Where everything is.
        stamp_ns: When [ns].
        rays: Finds what is in the way; None: visibility is unknown (NaN).
        eye_m: Position in `base_link` from which visibility is measured [m]: the LiDAR's in the named rigs.
    """
    boxes = boxes_at(timeline, stamp_ns)
    motion = timeline.ego_motion([stamp_ns])
    eye = motion.position_m[0] + quat_rotate(motion.quat_xyzw[0], eye_m)
    away = boxes.centre_m - eye
    distance = np.sqrt(np.sum(away * away, axis=-1))
    visible = np.full(len(boxes), np.nan)
    near = np.flatnonzero(distance < VISIBILITY_RANGE_M)
    if rays is not None and len(near):
        visible[near] = _visible(timeline, stamp_ns, rays, eye, boxes.take(near))
    return ObjectList(
        sensor="objects",
        frame_id="world",
        stamp_ns=int(stamp_ns),
        id=boxes.id.copy(),
        tag=boxes.tag.copy(),
        position_m=boxes.centre_m,
        heading_rad=boxes.heading_rad,
        pitch_rad=boxes.pitch_rad,
        roll_rad=boxes.roll_rad,
        size_m=boxes.size_m,
        velocity_mps=boxes.velocity_mps,
        yaw_rate_radps=boxes.yaw_rate_radps,
        visible=visible,
        distance_m=distance,
    )


def _visible(timeline: Timeline, stamp_ns: int, rays: RayScene, eye_m: Array, boxes: ActorBoxes) -> Array:
    """Fraction of each object that is not hidden behind other things, 0–1.

    Rays go to points spread evenly through the box; those that meet the object count as seen, those
    that something else stops before it as hidden, and those that pass it do not count.
    """
    index = np.repeat(np.arange(len(boxes)), _RAYS)
    inside = np.tile(_spread(_RAYS) - 0.5, (len(boxes), 1)) * 0.9 * boxes.size_m[index]
    towards = boxes.to_world(index, inside) - eye_m
    far = np.maximum(np.sqrt(np.sum(towards * towards, axis=-1)), 1e-6)
    hits = rays.cast(
        np.broadcast_to(eye_m, towards.shape),
        towards / far[:, None],
        np.full(len(far), stamp_ns, dtype=np.int64),
        timeline,
        1.5 * VISIBILITY_RANGE_M,
        ego=False,
    )
    met = hits.instance == boxes.id[index]
    size = np.sqrt(np.sum(boxes.size_m * boxes.size_m, axis=-1))
    stopped = ~met & (hits.range_m < far - 0.3 * size[index])
    seen, hidden = (np.bincount(index[kind], minlength=len(boxes)) for kind in (met, stopped))
    fraction: Array = seen / np.maximum(seen + hidden, 1)
    return fraction


def _spread(count: int) -> Array:
    """Points spread evenly through a unit cube (Halton's sequence, bases 2, 3, 5), shape (count, 3)."""
    columns = []
    for base in (2, 3, 5):
        values = np.zeros(count)
        left, fraction = np.arange(1, count + 1), 1.0
        while left.any():
            fraction /= base
            values += fraction * (left % base)
            left = left // base
        columns.append(values)
    return np.stack(columns, axis=-1)


def truth_at(
    timeline: Timeline, stamps_ns: Sequence[int], T_base_sensor: ArrayLike, *, frame_id: str = "base_link"
) -> list[Odometry]:
    """True motion of a frame on the car, one `Odometry` per stamp.

    Args:
        timeline: Where the ego was.
        stamps_ns: Times since the drive began [ns].
        T_base_sensor: Maps the frame's coordinates to `base_link`, shape (4, 4).
        frame_id: Name of the frame.
    """
    if not len(stamps_ns):
        return []
    motion = timeline.ego_motion(stamps_ns).at_mount(T_base_sensor)
    return [
        Odometry(
            sensor="truth",
            frame_id=frame_id,
            stamp_ns=int(stamp),
            position_m=motion.position_m[i].copy(),
            quat_xyzw=motion.quat_xyzw[i].copy(),
            velocity_world_mps=motion.velocity_world_mps[i].copy(),
            angular_rate_radps=motion.omega_body_radps[i].copy(),
            acceleration_world_mps2=motion.acceleration_world_mps2[i].copy(),
        )
        for i, stamp in enumerate(stamps_ns)
    ]
