"""Motion of a frame at some instants: pose, velocity, acceleration, rates, and those of a mount on it."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.parallel_arrays import ParallelArrays


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion(ParallelArrays):
    """Motion of a frame at M instants; world axes are ENU, `body` axes those of the frame."""

    stamp_ns: NDArray[np.int64]
    """Times since the drive began [ns], shape (M,)."""
    position_m: Array
    """Position of the frame's origin in the world [m], shape (M, 3)."""
    quat_xyzw: Array
    """Attitude, maps body to world, shape (M, 4)."""
    velocity_world_mps: Array
    """Velocity in world axes [m/s], shape (M, 3)."""
    acceleration_world_mps2: Array
    """Acceleration in world axes, gravity not included [m/s²], shape (M, 3)."""
    omega_body_radps: Array
    """Body rate [rad/s], shape (M, 3)."""
    alpha_body_radps2: Array
    """Angular acceleration in body axes [rad/s²], shape (M, 3)."""

    @property
    def T_world_frame(self) -> Array:
        """Poses, shape (M, 4, 4)."""
        return transforms.transform(self.position_m, self.quat_xyzw)

    def at_mount(self, T_frame_mount: ArrayLike) -> Motion:
        """Motion of a frame fixed to this one, lever arm included.

        a_mount = a + R(α×l + ω×(ω×l)), v_mount = v + R(ω×l).
        """
        T = np.asarray(T_frame_mount, dtype=np.float64)
        moved = self._moved_by(T[:3, 3]) if T[:3, 3].any() else self
        return moved if np.array_equal(T[:3, :3], np.eye(3)) else moved._turned_by(T[:3, :3])

    def _moved_by(self, lever_m: Array) -> Motion:
        w, q = self.omega_body_radps, self.quat_xyzw
        arm = np.broadcast_to(lever_m, w.shape)
        wl = transforms.cross(w, arm)
        turning = transforms.cross(self.alpha_body_radps2, arm) + transforms.cross(w, wl)
        return dataclasses.replace(
            self,
            position_m=self.position_m + transforms.quat_rotate(q, arm),
            velocity_world_mps=self.velocity_world_mps + transforms.quat_rotate(q, wl),
            acceleration_world_mps2=self.acceleration_world_mps2 + transforms.quat_rotate(q, turning),
        )

    def _turned_by(self, R_frame_mount: Array) -> Motion:
        rotate = transforms.from_rotation(R_frame_mount.T)
        return dataclasses.replace(
            self,
            quat_xyzw=transforms.quat_multiply(self.quat_xyzw, transforms.matrix_to_quat(R_frame_mount)),
            omega_body_radps=transforms.apply(rotate, self.omega_body_radps),
            alpha_body_radps2=transforms.apply(rotate, self.alpha_body_radps2),
        )
