"""The path of the car as writers learn it, pose by pose, and writers that wait for it."""

from abc import abstractmethod
from collections import deque
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import DTypeLike, NDArray

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.samples import Odometry, Sample
from recorder.writers.base import Encoder, Piece, Writer
from recorder.writers.rig_calibration import BASE_FRAME

POSE = "pose"
"""Place of pieces that hold a pose."""


def is_pose(sample: Sample) -> TypeGuard[Odometry]:
    """Whether a sample is the true pose of the car."""
    return isinstance(sample, Odometry) and sample.frame_id == BASE_FRAME


def pose_piece(sample: Odometry) -> Piece:
    """A pose as a piece: position [m] and quaternion xyzw of `base_link`."""
    values = np.concatenate([sample.position_m, sample.quat_xyzw]).astype("<f8")
    return Piece(sample.stamp_ns, POSE, "", values.tobytes())


class Steps:
    """What pieces hold over time, as numbers of a type, from which old steps may be dropped."""

    def __init__(self, kind: DTypeLike) -> None:
        self._kind = kind
        self._stamps_ns: deque[int] = deque()
        self._steps: deque[NDArray[Any]] = deque()

    def add(self, piece: Piece) -> None:
        """Take the next step."""
        self._stamps_ns.append(piece.stamp_ns)
        self._steps.append(np.frombuffer(piece.data, self._kind))

    def forget_before(self, stamp_ns: int) -> None:
        """Drop steps that times from `stamp_ns` [ns] on do not need."""
        while len(self._stamps_ns) > 1 and self._stamps_ns[1] <= stamp_ns:
            self._stamps_ns.popleft()
            self._steps.popleft()


class EgoPath(Steps):
    """Poses of `base_link` in the world."""

    def __init__(self) -> None:
        super().__init__("<f8")

    def at(self, stamp_ns: NDArray[np.int64]) -> tuple[Array, Array]:
        """Position [m] and attitude of `base_link` at times [ns], shapes (N, 3) and (N, 4)."""
        times, poses = np.array(self._stamps_ns), np.stack(self._steps)
        positions, quats = poses[:, :3], poses[:, 3:]
        after = np.clip(np.searchsorted(times, stamp_ns, side="right"), 1, len(times) - 1)
        fraction = (stamp_ns - times[after - 1]) / np.maximum(times[after] - times[after - 1], 1)
        position = positions[after - 1] + fraction[:, None] * (positions[after] - positions[after - 1])
        return position, transforms.quat_slerp(quats[after - 1], quats[after], fraction)

    def T_world_base(self, stamp_ns: int) -> Array:
        """Maps `base_link` at a time [ns] to the world, shape (4, 4)."""
        position, quat = self.at(np.array([stamp_ns]))
        return transforms.transform(position[0], quat[0])

    def to_world(self, points_m: Array, stamp_ns: NDArray[np.int64], T_base_sensor: Array) -> Array:
        """World coordinates [m] of points (N, 3) that a sensor on the car has seen at times (N,) [ns]."""
        position, quat = self.at(stamp_ns)
        in_base = transforms.apply(T_base_sensor, points_m)
        world: Array = transforms.quat_rotate(quat, in_base) + position
        return world


class FollowingWriter(Writer):
    """A writer that puts each piece when the car's path is known until the piece's end.

    The kind of a piece that takes time, such as a sweep, is its length [ns]; that of others is no number.
    """

    def __init__(self, target: str | Path, encoder: Encoder) -> None:
        super().__init__(target, encoder)
        self._path = EgoPath()
        self._known_ns = -1
        self._waiting: deque[Piece] = deque()

    def _place(self, piece: Piece) -> None:
        if piece.place == POSE:
            self._path.add(piece)
            self._known_ns = piece.stamp_ns
        else:
            self._waiting.append(piece)
        while self._waiting and self._end_ns(self._waiting[0]) <= self._known_ns:
            self._put(self._waiting.popleft())

    def _end_ns(self, piece: Piece) -> int:
        """Time until which all must be known [ns]: of a sweep, the step at or after its end."""
        length_ns = int(piece.kind) if piece.kind.isdigit() else 0
        return -(-(piece.stamp_ns + length_ns) // STEP_NS) * STEP_NS if length_ns else piece.stamp_ns

    def _put_last(self) -> None:
        """Put all pieces whose end is known, and drop the others."""
        for piece in self._waiting:
            if self._end_ns(piece) <= self._known_ns:
                self._put(piece)
        self._waiting.clear()

    @abstractmethod
    def _put(self, piece: Piece) -> None:
        """Put one piece into the file; the path covers its stamp to its end."""
