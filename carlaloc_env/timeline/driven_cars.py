"""Cars of a drive that have physics of their own: actors, for each other, at the poses of their splines."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.ego import EGO_CENTRE_M, EGO_ROLLING_RADIUS_M, EGO_SIZE_M
from carlaloc_env.core.elementary_kernels import arctan2
from carlaloc_env.core.jit import compiled
from carlaloc_env.core.transforms import from_rotation, quat_rotate
from carlaloc_env.timeline.actors import LIGHT_BRAKE, LIGHT_REVERSE, ActorCatalog, ActorFrame
from carlaloc_env.timeline.motion import Motion
from carlaloc_env.timeline.vehicle_track import BRAKE_FRACTION, CarTrack

if TYPE_CHECKING:
    from carlaloc_env.timeline.ego_spline import EgoTrack

MODEL = "electric_saloon"
"""Model family of such cars in `assets`."""
_TINTS = ((90, 6, 8), (8, 24, 88), (225, 150, 12), (12, 70, 34), (200, 200, 196), (92, 40, 96), (150, 60, 6))
"""Linear paint colours of the cars, over and over."""
_T_BASE_BOX = from_rotation(np.eye(3), (EGO_CENTRE_M, 0.0, 0.0))
"""The middle of the body's box, where an actor's position is."""
_GONE_M = (0.0, 0.0, -1000.0)
"""Place of cars that have left the drive."""
_KEPT_FRAMES = 3


class DrivenCars:
    """Tracks of C cars, and the cars as actors.

    Args:
        ids: Instance id of each as an actor.
        tracks: Spline, and wheels and pedals, of each.
        tag: Semantic tag of cars.
    """

    def __init__(self, ids: Sequence[int], tracks: Sequence[tuple[EgoTrack, CarTrack]], tag: int) -> None:
        self.tracks = tuple(tracks)
        count = len(ids)
        self.catalog = ActorCatalog(
            id=np.array(ids, np.uint32),
            model=(MODEL,) * count,
            tag=np.full(count, tag, np.uint8),
            size_m=np.tile(np.array(EGO_SIZE_M, np.float32), (count, 1)),
            tint=np.array([_TINTS[c % len(_TINTS)] for c in range(count)], np.uint8).reshape(-1, 3),
        )
        self.gone = np.zeros(count, np.bool_)
        """Whether each has left the drive."""
        self._kept: deque[tuple[int, ActorFrame]] = deque(maxlen=_KEPT_FRAMES)

    def __len__(self) -> int:
        return len(self.tracks)

    def leave(self, car: int) -> None:
        """Take a car out of the drive from now on."""
        self.gone[car] = True
        self._kept.clear()

    def frame_at(self, stamp_ns: int) -> ActorFrame:
        """State of all cars as actors at a time [ns]."""
        for stamp, frame in self._kept:
            if stamp == stamp_ns:
                return frame
        count, stamps = len(self), np.array([stamp_ns])
        columns, of_car = np.zeros((count, 7)), np.zeros((count, 2), np.float32)
        columns[:, :3] = _GONE_M
        lights = np.zeros(count, np.uint8)
        for c in np.flatnonzero(~self.gone).tolist():
            track, car = self.tracks[c]
            columns[c] = _columns(track.motion(stamps))[0]
            if len(car):
                angle, steer, brake, reverse = car.one_at(stamp_ns)
                of_car[c] = angle * EGO_ROLLING_RADIUS_M, steer
                lights[c] = (brake > BRAKE_FRACTION) * LIGHT_BRAKE + reverse * LIGHT_REVERSE
        p = columns.astype(np.float32)
        frame = ActorFrame(
            position_m=p[:, :3], heading_rad=p[:, 3], pitch_rad=p[:, 4], roll_rad=p[:, 5], speed_mps=p[:, 6],
            travelled_m=of_car[:, 0], steer_rad=of_car[:, 1], lights=lights,
        )  # fmt: skip
        self._kept.append((stamp_ns, frame))
        return frame

    def poses(self, car: NDArray[np.intp], stamps_ns: NDArray[np.int64]) -> Array:
        """Position [m], heading, pitch and roll [rad] of cars at times, each of shape (M,), as (M, 6)."""
        out = np.tile((*_GONE_M, 0.0, 0.0, 0.0), (len(car), 1))
        for c in np.unique(car):
            rows = np.flatnonzero(car == c)
            times, back = np.unique(stamps_ns[rows], return_inverse=True)
            if not self.gone[c]:
                out[rows] = _columns(self.tracks[c][0].motion(times))[back, :6]
        return out

    def rates_at(self, car: NDArray[np.intp], stamp_ns: int) -> tuple[Array, Array]:
        """Velocities [m/s], world, (K, 3), and yaw rates [rad/s], (K,), of cars at a time [ns]."""
        velocity, rate = np.zeros((len(car), 3)), np.zeros(len(car))
        for k, c in enumerate(car):
            if self.gone[c]:
                continue
            motion = self.tracks[int(c)][0].motion(np.array([stamp_ns])).at_mount(_T_BASE_BOX)
            velocity[k] = motion.velocity_world_mps[0]
            q, omega = motion.quat_xyzw, motion.omega_body_radps[0]
            ahead = quat_rotate(q, np.array([[1.0, 0.0, 0.0]]))[0]
            turning = quat_rotate(q, np.array([[0.0, omega[2], -omega[1]]]))[0]
            rate[k] = (ahead[0] * turning[1] - ahead[1] * turning[0]) / (ahead[0] ** 2 + ahead[1] ** 2)
        return velocity, rate


def _columns(motion: Motion) -> Array:
    """Position [m], heading, pitch (nose up), roll (left side up) [rad] and forward speed [m/s], (M, 7)."""
    out = np.empty((len(motion.stamp_ns), 7))
    _put_columns(motion.position_m, motion.quat_xyzw, motion.velocity_world_mps, out)
    return out


@compiled
def _put_columns(position_m: Array, quat_xyzw: Array, velocity_mps: Array, out: Array) -> None:
    """Write the columns of actors whose `base_link` moves so, (M, 3), (M, 4), (M, 3), into (M, 7)."""
    for m in range(len(out)):
        x, y, z, w = quat_xyzw[m, 0], quat_xyzw[m, 1], quat_xyzw[m, 2], quat_xyzw[m, 3]
        ahead_x, ahead_y = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z)
        ahead_z = 2.0 * (x * z - w * y)
        out[m, 0] = position_m[m, 0] + EGO_CENTRE_M * ahead_x
        out[m, 1] = position_m[m, 1] + EGO_CENTRE_M * ahead_y
        out[m, 2] = position_m[m, 2] + EGO_CENTRE_M * ahead_z
        out[m, 3] = arctan2(ahead_y, ahead_x)
        out[m, 4] = arctan2(ahead_z, sqrt(ahead_x * ahead_x + ahead_y * ahead_y))
        out[m, 5] = arctan2(2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y))
        v = velocity_mps[m]
        out[m, 6] = ahead_x * v[0] + ahead_y * v[1] + ahead_z * v[2]
