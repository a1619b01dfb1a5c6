"""Trajectories: poses of a frame over time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trajectory:
    """Poses of a frame over time."""

    stamp_ns: NDArray[np.int64]
    """Times [ns], strictly increasing, shape (N,)."""
    position_m: Array
    """Positions [m], shape (N, 3)."""
    quat_xyzw: Array
    """Attitudes, map the frame to the world, unit quaternions, shape (N, 4)."""
    name: str = ""
    """Its name in results."""
    has_attitudes: bool = True
    """Whether the attitudes were measured; else they are the identity and mean nothing."""
    notes: tuple[str, ...] = ()
    """Poses of its file that cannot be right, a line each."""

    def __post_init__(self) -> None:
        count = len(self.stamp_ns)
        if self.position_m.shape != (count, 3) or self.quat_xyzw.shape != (count, 4):
            raise EvaluationError(
                f"trajectory '{self.name}': {count} stamps, positions {self.position_m.shape}, "
                f"quaternions {self.quat_xyzw.shape}; give (N,), (N, 3), (N, 4)"
            )
        if not (np.isfinite(self.position_m).all() and np.isfinite(self.quat_xyzw).all()):
            raise EvaluationError(f"trajectory '{self.name}' holds a number that is not finite")
        if np.any(np.abs(np.einsum("ij,ij->i", self.quat_xyzw, self.quat_xyzw) - 1.0) > 1e-3):
            raise EvaluationError(f"trajectory '{self.name}' holds a quaternion that is not of length 1")
        if np.any(np.diff(self.stamp_ns) <= 0):
            raise EvaluationError(f"trajectory '{self.name}' has stamps that do not increase")

    def __len__(self) -> int:
        return len(self.stamp_ns)

    @property
    def duration_s(self) -> float:
        """Time from the first to the last pose [s]."""
        return float(self.stamp_ns[-1] - self.stamp_ns[0]) * 1e-9 if len(self) else 0.0

    @property
    def length_m(self) -> float:
        """Length of the path through all positions [m]."""
        return float(np.sum(np.sqrt(np.sum(np.diff(self.position_m, axis=0) ** 2, axis=1))))

    def take(self, index: NDArray[np.intp]) -> Trajectory:
        """Trajectory of some of the poses."""
        return replace(
            self,
            stamp_ns=self.stamp_ns[index],
            position_m=self.position_m[index],
            quat_xyzw=self.quat_xyzw[index],
        )

    def at(self, stamp_ns: NDArray[np.int64]) -> Trajectory:
        """Interpolated poses at increasing times [ns], shape (M,); beyond the ends the first or last pose."""
        after = np.searchsorted(self.stamp_ns, stamp_ns)
        exact = self.stamp_ns[np.minimum(after, len(self) - 1)] == stamp_ns
        before = np.clip(np.where(exact, after, after - 1), 0, len(self) - 1)
        after = np.clip(after, 0, len(self) - 1)
        span = np.maximum(self.stamp_ns[after] - self.stamp_ns[before], 1)
        fraction = (stamp_ns - self.stamp_ns[before]) / span
        start = self.position_m[before]
        return replace(
            self,
            stamp_ns=stamp_ns,
            position_m=start + fraction[:, None] * (self.position_m[after] - start),
            quat_xyzw=transforms.quat_slerp(self.quat_xyzw[before], self.quat_xyzw[after], fraction),
        )

    def shifted(self, offset_ns: int) -> Trajectory:
        """The same poses, later by an offset [ns]."""
        return replace(self, stamp_ns=self.stamp_ns + offset_ns)

    def of_sensor(self, T_body_sensor: ArrayLike) -> Trajectory:
        """Trajectory of a sensor fixed to this frame, its lever arm included.

        Args:
            T_body_sensor: Maps sensor coordinates to this trajectory's frame, shape (4, 4).

        Raises:
            EvaluationError: there are no attitudes that a lever arm could follow.
        """
        T = np.asarray(T_body_sensor, dtype=np.float64)
        if not self.has_attitudes and T[:3, 3].any():
            raise EvaluationError(f"'{self.name}' has no attitudes, which a lever arm needs; give none")
        lever = np.broadcast_to(T[:3, 3], self.position_m.shape)
        return replace(
            self,
            position_m=self.position_m + transforms.quat_rotate(self.quat_xyzw, lever),
            quat_xyzw=transforms.quat_multiply(self.quat_xyzw, transforms.matrix_to_quat(T[:3, :3])),
        )
