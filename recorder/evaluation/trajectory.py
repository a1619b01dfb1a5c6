"""Trajectories with integer stamps, and the TUM files they come from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError

_NANOSECONDS_FROM = 10**14
"""Larger stamps are nanoseconds: as seconds they would lie three million years ahead."""


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
    """What it is called in results."""

    def __post_init__(self) -> None:
        count = len(self.stamp_ns)
        if self.position_m.shape != (count, 3) or self.quat_xyzw.shape != (count, 4):
            raise EvaluationError(
                f"trajectory '{self.name}': {count} stamps, positions {self.position_m.shape}, "
                f"quaternions {self.quat_xyzw.shape}; give (N,), (N, 3), (N, 4)"
            )
        if not (np.isfinite(self.position_m).all() and np.isfinite(self.quat_xyzw).all()):
            raise EvaluationError(f"trajectory '{self.name}' holds a number that is not finite")
        if np.any(np.abs(np.sum(self.quat_xyzw**2, axis=1) - 1.0) > 1e-3):
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
        """Some of the poses."""
        return replace(
            self,
            stamp_ns=self.stamp_ns[index],
            position_m=self.position_m[index],
            quat_xyzw=self.quat_xyzw[index],
        )

    def shifted(self, offset_ns: int) -> Trajectory:
        """The same poses, later by an offset [ns]."""
        return replace(self, stamp_ns=self.stamp_ns + offset_ns)

    def of_sensor(self, T_body_sensor: ArrayLike) -> Trajectory:
        """Trajectory of a sensor fixed to this frame, its lever arm included.

        Args:
            T_body_sensor: Maps sensor coordinates to this trajectory's frame, shape (4, 4).
        """
        T = np.asarray(T_body_sensor, dtype=np.float64)
        lever = np.broadcast_to(T[:3, 3], self.position_m.shape)
        return replace(
            self,
            position_m=self.position_m + transforms.quat_rotate(self.quat_xyzw, lever),
            quat_xyzw=transforms.quat_multiply(self.quat_xyzw, transforms.matrix_to_quat(T[:3, :3])),
        )


def read_tum(path: str | Path) -> Trajectory:
    """Read "time tx ty tz qx qy qz qw" lines; lines that begin with # are comments.

    Stamps are read exactly; seconds, and the nanoseconds that ORB-SLAM3 writes, are told apart by size.

    Raises:
        EvaluationError: the file is missing or a line is not such a line.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise EvaluationError(f"cannot read {path}: {error}; give a TUM file") from error
    stamps: list[int] = []
    values: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.replace(",", " ").split()
        if not words or words[0].startswith("#"):
            continue
        try:
            stamps.append(_nanoseconds(words[0]))
            values.append([float(word) for word in words[1:]])
        except (ValueError, InvalidOperation, OverflowError):
            values.append([])
        if len(values[-1]) != 7:
            raise EvaluationError(f"{path} line {number} is not 'time tx ty tz qx qy qz qw'; give a TUM file")
    if not stamps:
        raise EvaluationError(f"{path} holds no pose")
    order = np.argsort(np.array(stamps, dtype=np.int64), kind="stable")
    table = np.array(values)[order]
    stamp_ns = np.array(stamps, dtype=np.int64)[order]
    # Some systems write a pose twice when they correct it; the last one counts.
    last = np.append(np.diff(stamp_ns) > 0, True)
    table, stamp_ns = table[last], stamp_ns[last]
    norm = np.sqrt(np.sum(table[:, 3:] ** 2, axis=1, keepdims=True))
    if not np.all(np.abs(norm - 1.0) < 0.01):
        raise EvaluationError(f"{path} holds a quaternion that is not of length 1; the order is x y z w")
    return Trajectory(
        stamp_ns=stamp_ns, position_m=table[:, :3].copy(), quat_xyzw=table[:, 3:] / norm, name=path.stem
    )


def tum_text(unix_ns: NDArray[np.int64], position_m: Array, quat_xyzw: Array) -> str:
    """A TUM file: stamps [ns] (N,), positions [m] (N, 3), quaternions (N, 4); all read back exactly."""
    rows = zip(unix_ns.tolist(), position_m.tolist(), quat_xyzw.tolist(), strict=True)
    lines = [
        f"{stamp // 10**9}.{stamp % 10**9:09d} " + " ".join(repr(value) for value in (*position, *quat))
        for stamp, position, quat in rows
    ]
    return "\n".join(["# timestamp tx ty tz qx qy qz qw", *lines]) + "\n"


def write_tum(path: str | Path, trajectory: Trajectory) -> Path:
    """Write a trajectory as "time tx ty tz qx qy qz qw" lines; an older file is replaced.

    Raises:
        EvaluationError: the file cannot be written.
    """
    path = Path(path)
    part = path.with_name(f".{path.name}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        text = tum_text(trajectory.stamp_ns, trajectory.position_m, trajectory.quat_xyzw)
        part.write_text(text, encoding="utf-8")
        part.replace(path)
    except OSError as error:
        raise EvaluationError(f"cannot write {path}: {error.strerror}; choose another folder") from error
    return path


def _nanoseconds(text: str) -> int:
    value = Decimal(text)
    stamp_ns = round(value if abs(value) >= _NANOSECONDS_FROM else value * 1_000_000_000)
    if not -(2**63) <= stamp_ns < 2**63:
        raise OverflowError(f"{text} is no time")
    return stamp_ns
