"""Trajectories: poses with stamps, their order, and their covariances.

Poses as a file holds them, put in the order of their times.

Covariances of poses as text beside a trajectory, in the form that smfeval reads as well.

``estimate.cov`` stands beside ``estimate.tum`` and has a row for each pose: the stamp [s] and the lower
triangle of a 6×6 matrix, row by row. The matrix is that of ξ = (x, y, z [m], rotation about them [rad]) in
T_estimate = T_true · exp(ξ), the axes being those of the frame whose pose it is (the right perturbation).

Small errors of poses and their covariances on SE(3), vectorised over leading axes.

A tangent vector ξ = (translation [m], rotation [rad]) is in the body's axes: T_estimate = T_true · exp(ξ).
Barfoot, State Estimation for Robotics (2nd edition 2024), chapter 8; Barfoot and Furgale, "Associating
uncertainty with three-dimensional poses for use in estimation problems", T-RO 30 (2014).
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.files.atomic_files import atomic_write
from carlaloc_env.core.files.text_files import read_text
from carlaloc_env.core.transforms import invert, matrix_to_quat, quat_to_rotvec


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
        """Some of the poses."""
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


_POSITION_MAX_M = 1e9
"""Positions beyond are no trajectory of this world [m]."""
_LENGTH_MIN_M, _WIDTH_MIN = 1.0, 0.05
"""A path of this spread [m], and of this part of it beside its direction, turns."""
_SPIKE_M, _SPIKE_STEPS = 1.0, 10.0
"""A pose that is farther from both its neighbours, also in usual steps, is impossible if these are close."""
_RUN_STEPS, _RUN_POSES = 10, 10
"""A run begins where stamps jump back by more than so many steps, after at least so many poses on average."""
_LOG = logging.getLogger(__name__)


def in_order(
    path: Path,
    stamp_ns: NDArray[np.int64],
    position_m: Array,
    quat_xyzw: Array | None,
    place: Callable[[int], str] = lambda row: f"pose {row + 1}",
) -> Trajectory:
    """The trajectory of what a file holds.

    Poses that are not finite are left out, others sorted, of poses of one time the last one counts; each
    with a warning. Attitudes that are all missing, zero, or the same along a path that turns are none.

    Args:
        path: The file.
        stamp_ns: Times [ns], shape (N,).
        position_m: Positions [m], shape (N, 3).
        quat_xyzw: Attitudes, shape (N, 4); None: it holds none.
        place: Where in the file a row stands.

    Raises:
        EvaluationError: no pose is finite, a quaternion is far from unit length, or the file holds two runs.
    """
    has_attitudes = quat_xyzw is not None and not _are_none(quat_xyzw, position_m)
    if quat_xyzw is None or not has_attitudes:
        quat_xyzw = np.tile([0.0, 0.0, 0.0, 1.0], (len(position_m), 1))
    finite: NDArray[np.bool_] = np.all(np.isfinite(np.hstack([position_m, quat_xyzw])), axis=1)
    if not finite.any():
        raise EvaluationError(f"{path} holds only poses that are not finite")
    rows = np.flatnonzero(finite)
    if not finite.all():
        lost = len(finite) - int(finite.sum())
        _LOG.warning("%s: %d of %d poses are not finite; left out", path, lost, len(finite))
        stamp_ns, position_m, quat_xyzw = stamp_ns[finite], position_m[finite], quat_xyzw[finite]
    if (beyond := np.any(np.abs(position_m) >= _POSITION_MAX_M, axis=1)).any():
        where = place(int(rows[np.argmax(beyond)]))
        raise EvaluationError(f"{path} holds a position beyond {_POSITION_MAX_M:g} m ({where}); give metres")
    with np.errstate(over="ignore"):
        norm = np.sqrt(np.sum(quat_xyzw**2, axis=1, keepdims=True))
    if (wrong := ~(np.abs(norm[:, 0] - 1.0) < 0.01)).any():
        first = int(np.argmax(wrong))
        few = 2 * np.count_nonzero(wrong) < len(wrong)
        cure = "correct or remove it; is an exponent lost?" if few else "name its columns in a header"
        raise EvaluationError(
            f"{path} holds a quaternion that is not of length 1 ({place(int(rows[first]))}) but of "
            f"{norm[first, 0]:.3g}; {cure}"
        )
    _check_runs(path, stamp_ns)
    order = np.argsort(stamp_ns, kind="stable")
    # Some systems write a pose twice when they correct it.
    kept = order[np.append(np.diff(stamp_ns[order]) > 0, True)]
    if len(kept) < len(order):
        hint = "; are stamps written with too few digits?" if 2 * len(kept) < len(order) else ""
        _LOG.warning(
            "%s: %d of %d poses share a stamp with a later line, which counts%s",
            path, len(order) - len(kept), len(order), hint,
        )  # fmt: skip
    return Trajectory(
        stamp_ns=stamp_ns[kept],
        position_m=position_m[kept],
        quat_xyzw=quat_xyzw[kept] / norm[kept],
        name=path.stem,
        has_attitudes=has_attitudes,
        notes=_impossible(position_m[kept], lambda row: f"{path} {place(int(rows[kept[row]]))}"),
    )


def _are_none(quat_xyzw: Array, position_m: Array) -> bool:
    """Whether attitudes are all missing or zero, or all the same although the path turns."""
    given = quat_xyzw[np.isfinite(quat_xyzw).all(axis=1)]
    path_m = position_m[(np.abs(position_m) < _POSITION_MAX_M).all(axis=1)]
    if not given.any() or len(path_m) < 3:
        return not given.any()
    spread_m = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(path_m.T)), 0.0))
    turns = spread_m[2] > _LENGTH_MIN_M and spread_m[1] > _WIDTH_MIN * spread_m[2]
    with np.errstate(over="ignore"):
        is_one = np.ptp(given, axis=0).max() < 1e-9 and abs(np.linalg.norm(given[0]) - 1.0) < 0.01
    return bool(turns and is_one)


def _impossible(position_m: Array, place: Callable[[int], str]) -> tuple[str, ...]:
    """A line for positions far from those before and after, which are close to each other."""
    if len(position_m) < 3:
        return ()
    steps_m = np.linalg.norm(np.diff(position_m, axis=0), axis=1)
    away_m = np.minimum(steps_m[:-1], steps_m[1:])
    beside_m = np.linalg.norm(position_m[2:] - position_m[:-2], axis=1)
    least_m = max(_SPIKE_M, _SPIKE_STEPS * float(np.median(steps_m)))
    found = np.flatnonzero((away_m > least_m) & (beside_m < 0.2 * away_m))
    if not len(found):
        return ()
    others = f", and {len(found) - 1} more like it" if len(found) > 1 else ""
    where, far_m = place(int(found[0]) + 1), away_m[found[0]]
    return (
        f"{where}: impossible position, {far_m:.4g} m from the poses before and after it{others}; correct or "
        "remove it; is an exponent or a digit lost?",
    )


def _check_runs(path: Path, stamp_ns: NDArray[np.int64]) -> None:
    step = np.diff(stamp_ns)
    if not (back := np.flatnonzero(step < 0)).size:
        return
    usual = float(np.median(np.abs(step)))
    runs = back[-step[back] > _RUN_STEPS * usual]
    if runs.size == back.size and runs.size <= len(stamp_ns) / _RUN_POSES:
        raise EvaluationError(
            f"{path} holds {runs.size + 1} runs: stamps jump back by {-step[runs[0]] / 1e9:.6g} s "
            f"after pose {runs[0] + 1}; give a file for each run"
        )
    _LOG.warning("%s: the poses are not in the order of their times; sorted", path)


SUFFIX = ".cov"
"""Suffix of the file, in place of the trajectory's own."""
_HEADER = {"#%TANGENT_CONVENTION": "right_perturbation", "#%TANGENT_ORDER": "translation_rotation"}
_ROWS, _COLUMNS = np.tril_indices(6)
_STAMP_NS = 1_000
"""Stamps of a pose and its covariance may differ so much, by rounding [ns]."""


def write_covariances(path: Path, trajectory: Trajectory, covariance: Array) -> Path:
    """Write the covariances of a trajectory's poses; an older file is replaced.

    Args:
        path: The trajectory's file, or the file itself.
        trajectory: The poses.
        covariance: Their covariances, shape (N, 6, 6).

    Raises:
        EvaluationError: the file cannot be written.
    """
    lines = stamped_lines(trajectory.stamp_ns, covariance[:, _ROWS, _COLUMNS])
    head = [f"{key} {word}" for key, word in _HEADER.items()]
    with atomic_write(path.with_suffix(SUFFIX), EvaluationError) as part:
        part.write_text("\n".join([*head, "# timestamp c11 c21 c22 c31 … c66", *lines]) + "\n", "utf-8")
    return path.with_suffix(SUFFIX)


def stamped_lines(stamp_ns: NDArray[np.int64], values: Array) -> list[str]:
    """Lines of stamps [ns], shape (N,), in seconds, and numbers, shape (N, M); all are read back exactly."""
    return [
        f"{stamp // 10**9}.{stamp % 10**9:09d} " + " ".join(map(repr, row))
        for stamp, row in zip(stamp_ns.tolist(), values.tolist(), strict=True)
    ]


def read_covariances(path: Path, trajectory: Trajectory) -> Array | None:
    """Covariances of a trajectory's poses, shape (N, 6, 6); None: there is no such file.

    Args:
        path: The trajectory's file, or the file itself.
        trajectory: The poses.

    Raises:
        EvaluationError: the file is damaged, has another convention, or its rows are not those of the poses.
    """
    path = path.with_suffix(SUFFIX)
    if not path.exists():
        return None
    rows = []
    lines = read_text(path, "covariances", EvaluationError).splitlines()
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if words and words[0] in _HEADER and words[1:] != [_HEADER[words[0]]]:
            raise EvaluationError(f"{path}: '{line}' is not read; write {_HEADER[words[0]]}")
        if words and not line.startswith("#"):
            rows.append(_row(path, number, words))
    stamp_ns = np.array([stamp for stamp, _ in rows], np.int64)
    same = len(rows) == len(trajectory) and not np.any(np.abs(stamp_ns - trajectory.stamp_ns) > _STAMP_NS)
    if not same:
        raise EvaluationError(f"{path} needs a row for each of {len(trajectory)} poses, with their stamps")
    covariance = np.zeros((len(rows), 6, 6))
    covariance[:, _ROWS, _COLUMNS] = covariance[:, _COLUMNS, _ROWS] = [values for _, values in rows]
    return covariance


def _row(path: Path, number: int, words: list[str]) -> tuple[int, list[float]]:
    try:
        whole, _, part = words[0].partition(".")
        stamp_ns = int(whole) * 10**9 + int(part[:9].ljust(9, "0"))
        values = [float(word) for word in words[1:]]
    except ValueError:
        values = []
    if len(values) != len(_ROWS) or not np.isfinite(values).all():
        raise EvaluationError(f"{path} line {number} is no stamp [s] with 21 numbers of a 6×6 lower triangle")
    return stamp_ns, values


_SMALL_RAD = 1e-4
"""Below this angle, series take the place of quotients that cancel [rad]."""


def log_se3(T: ArrayLike) -> Array:
    """Tangent vectors of poses, shape (..., 4, 4) to (..., 6)."""
    T = np.asarray(T, dtype=np.float64)
    turn = quat_to_rotvec(matrix_to_quat(T[..., :3, :3]))
    W, angle = cross_matrix(turn), np.linalg.norm(turn, axis=-1)
    is_small = angle < _SMALL_RAD
    half = np.where(is_small, 1.0, 0.5 * angle)
    quotient = (1.0 - half / np.tan(half)) / (4.0 * half * half)
    factor = np.where(is_small, 1.0 / 12.0, quotient)[..., None, None]
    V_inverse = np.eye(3) - 0.5 * W + factor * (W @ W)
    shift = (V_inverse @ T[..., :3, 3:])[..., 0]
    return np.concatenate([shift, turn], axis=-1)


def adjoint(T: ArrayLike) -> Array:
    """Maps tangent vectors of frame b to frame a for poses ``T_a_b``, shape (..., 4, 4) to (..., 6, 6)."""
    T = np.asarray(T, dtype=np.float64)
    R = T[..., :3, :3]
    upper = np.concatenate([R, cross_matrix(T[..., :3, 3]) @ R], axis=-1)
    return np.concatenate([upper, np.concatenate([np.zeros_like(R), R], axis=-1)], axis=-2)


def moved_covariance(T: ArrayLike, covariance: ArrayLike) -> Array:
    """Covariances Ad(T) Σ Ad(T)ᵀ of tangent vectors that are mapped by ``T_a_b``, shape (..., 6, 6)."""
    Ad = adjoint(T)
    return Ad @ np.asarray(covariance, dtype=np.float64) @ np.swapaxes(Ad, -1, -2)


def composed_covariance(covariance: ArrayLike, step: ArrayLike, step_covariance: ArrayLike) -> Array:
    """Covariance of the pose T · step, to first order, where the errors of both are independent.

    Args:
        covariance: That of T, shape (..., 6, 6).
        step: The step, shape (..., 4, 4).
        step_covariance: That of the step, shape (..., 6, 6).
    """
    return moved_covariance(invert(step), covariance) + np.asarray(step_covariance, dtype=np.float64)


def cross_matrix(v: Array) -> Array:
    """Matrices that multiply vectorially from the left, shape (..., 3) to (..., 3, 3)."""
    W = np.zeros((*v.shape[:-1], 3, 3))
    for row, column, axis, sign in ((0, 1, 2, -1), (0, 2, 1, 1), (1, 2, 0, -1)):
        W[..., row, column], W[..., column, row] = sign * v[..., axis], -sign * v[..., axis]
    return W
