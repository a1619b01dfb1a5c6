"""Bounding boxes of all actors at one instant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.parallel_arrays import ParallelArrays
from carlaloc_env.core.transforms import wrap_angle
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.timeline.timeline import Timeline


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ActorBoxes(ParallelArrays):
    """Boxes around N actors at one instant."""

    id: NDArray[np.uint32]
    """Instance id, the one that points and pixels carry, shape (N,)."""
    tag: NDArray[np.uint8]
    """Semantic `Tag`, shape (N,)."""
    centre_m: Array
    """Middle of each box [m], world, shape (N, 3)."""
    heading_rad: Array
    """Direction the actor faces, anticlockwise from east [rad], shape (N,)."""
    pitch_rad: Array
    """Nose up positive [rad], shape (N,)."""
    roll_rad: Array
    """Left side up positive [rad], shape (N,)."""
    size_m: Array
    """Length, width, height [m], shape (N, 3)."""
    velocity_mps: Array
    """Velocity of the point on the ground below the box's middle [m/s], world, shape (N, 3)."""
    yaw_rate_radps: Array
    """Rate of the heading [rad/s], shape (N,)."""

    def __len__(self) -> int:
        return len(self.id)

    @property
    def axes(self) -> Array:
        """Unit vectors ahead, left and up of each box as rows, world, shape (N, 3, 3)."""
        ch, sh = elementary.cos(self.heading_rad), elementary.sin(self.heading_rad)
        cp, sp = elementary.cos(self.pitch_rad), elementary.sin(self.pitch_rad)
        cr, sr = elementary.cos(self.roll_rad)[:, None], elementary.sin(self.roll_rad)[:, None]
        zero = np.zeros(len(self))
        ahead = np.stack([cp * ch, cp * sh, sp], axis=-1)
        left = np.stack([-sh, ch, zero], axis=-1)
        up = np.stack([-sp * ch, -sp * sh, cp], axis=-1)
        return np.stack([ahead, cr * left + sr * up, cr * up - sr * left], axis=1)

    def to_world(self, index: NDArray[np.intp], local_m: Array) -> Array:
        """World coordinates [m] of points (M, 3) given from the middles of boxes `index` (M,)."""
        axes = self.axes[index]
        moved: Array = self.centre_m[index] + sum(local_m[:, k, None] * axes[:, k] for k in range(3))
        return moved

    def velocity_at(self, index: NDArray[np.intp], points_m: Array) -> Array:
        """Velocity [m/s] of points (M, 3) [m] fixed to boxes `index` (M,), world."""
        arm = points_m - self.centre_m[index]
        rate = self.yaw_rate_radps[index]
        turning = np.stack([-rate * arm[:, 1], rate * arm[:, 0], np.zeros(len(arm))], axis=-1)
        return self.velocity_mps[index] + turning


def boxes_at(timeline: Timeline, stamp_ns: int) -> ActorBoxes:
    """Boxes of all actors at a time [ns].

    Velocities are those of the positions that images and rays show: actors move straight between
    50 ms steps, so the velocity is that of the stretch which ends at or contains the stamp. Cars with
    physics of their own have that of their spline.
    """
    catalog = timeline.catalog
    count = len(catalog)
    upright = catalog.tag == Tag.PEDESTRIAN  # they stay so on a slope
    size = catalog.size_m.astype(np.float64)
    if count == 0:
        position = velocity = np.zeros((0, 3))
        heading = pitch = roll = rate = np.zeros(0)
    elif stamp_ns <= 0:
        frame = timeline.actors_at(0)
        position, heading, pitch, roll = (
            np.asarray(values, dtype=np.float64)
            for values in (frame.position_m, frame.heading_rad, frame.pitch_rad, frame.roll_rad)
        )
        level = frame.speed_mps * elementary.cos(pitch)
        east, north = level * elementary.cos(heading), level * elementary.sin(heading)
        velocity = np.stack([east, north, frame.speed_mps * elementary.sin(pitch)], axis=-1)
        rate = np.zeros(count)
    else:
        begin = (stamp_ns - 1) // STEP_NS * STEP_NS
        index, stamps = np.arange(count), np.array([stamp_ns, begin], dtype=np.int64)
        poses = timeline.actor_poses(np.concatenate([index, index]), np.repeat(stamps, count))
        (position, heading, pitch, roll), (position_before, heading_before, _, _) = (
            tuple(values[rows] for values in poses) for rows in (slice(count), slice(count, None))
        )
        span_s = (stamp_ns - begin) * 1e-9
        velocity = (position - position_before) / span_s
        rate = wrap_angle(heading - heading_before) / span_s
    driven_velocity, driven_rate = timeline.car_rates_at(stamp_ns)
    if len(driven_rate):
        velocity[-len(driven_rate) :], rate[-len(driven_rate) :] = driven_velocity, driven_rate
    pitch, roll = np.where(upright, 0.0, pitch), np.where(upright, 0.0, roll)
    centre = position.copy()
    lift = 0.5 * size[:, 2]
    back, right = lift * elementary.sin(pitch) * elementary.cos(roll), lift * elementary.sin(roll)
    centre[:, 0] += right * elementary.sin(heading) - back * elementary.cos(heading)
    centre[:, 1] -= right * elementary.cos(heading) + back * elementary.sin(heading)
    centre[:, 2] += lift * elementary.cos(pitch) * elementary.cos(roll)
    return ActorBoxes(
        id=catalog.id,
        tag=catalog.tag,
        centre_m=centre,
        heading_rad=heading,
        pitch_rad=pitch,
        roll_rad=roll,
        size_m=size,
        velocity_mps=velocity,
        yaw_rate_radps=rate,
    )
