"""Errors of an estimator's runs over one drive: of each pose since the first one, and over a fixed distance.

Odometry drifts: an error at the end of a drive is mostly that of its first turns, so both are measured.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.transforms import invert, transform
from recorder.evaluation.associate import Association, associate
from recorder.evaluation.se3 import log_se3, moved_covariance
from recorder.evaluation.trajectory import Trajectory

AXES = ("along", "across", "up", "roll", "pitch", "yaw")
"""Components of an error: position in the body's axes forward, left, up [m], then turns about them [rad]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Run:
    """An estimate of a drive with the noise of one seed."""

    estimate: Trajectory
    """Poses."""
    covariance: Array | None
    """Their covariances, see `recorder.evaluation.trajectory`, (N, 6, 6); None: none stated."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseErrors:
    """Errors of S runs between P pairs of poses."""

    kind: str
    """Name of the kind of pairs."""
    distance_m: Array
    """True distance driven up to the second pose of each pair [m], shape (P,)."""
    error: Array
    """log(T_true⁻¹ · T_estimate) of the motion from the first to the second pose, `AXES`, shape (S, P, 6)."""
    covariance: Array | None
    """What was stated for it, shape (S, P, 6, 6); None: nothing."""


def pose_errors(
    truth: Trajectory,
    runs: Sequence[Run],
    *,
    over_m: float,
    tied: bool = True,
    T_base_frame: Array | None = None,
) -> tuple[PoseErrors, ...]:
    """Errors of all runs, since the first pose and, where the drive is as long, over a distance.

    Args:
        truth: True poses of the frame.
        runs: Runs over the drive, at least one.
        over_m: The distance [m].
        tied: Whether estimates begin anywhere, so that their first pose is laid on the true one.
        T_base_frame: Maps the frame to the body in whose axes errors are given, (4, 4); None: it is the body.

    Raises:
        EvaluationError: runs have no poses in common with the truth or each other.
    """
    matched = [associate(truth, run.estimate, Association.INTERPOLATED) for run in runs]
    common = reduce(np.intersect1d, [estimate.stamp_ns for _, estimate in matched])
    if len(common) < 2:
        raise EvaluationError(f"{len(runs)} runs of '{runs[0].estimate.name}' have no two stamps in common")
    T_true = _poses(truth.at(common))
    estimates = [run.estimate.take(np.searchsorted(run.estimate.stamp_ns, common)) for run in runs]
    T = np.stack([_poses(estimate) for estimate in estimates])
    covariance = None
    if all(run.covariance is not None for run in runs):
        covariance = np.stack([_rows(run, common) for run in runs])
    if T_base_frame is not None:
        T_true, T = T_true @ invert(T_base_frame), T @ invert(T_base_frame)
        covariance = None if covariance is None else moved_covariance(T_base_frame, covariance)
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(T_true[:, :3, 3], axis=0), axis=1))])
    later = np.arange(1 if tied else 0, len(common))
    if tied:
        since_start = _between(T_true, T, covariance, np.zeros_like(later), later)
    else:
        since_start = log_se3(invert(T_true[later]) @ T[:, later]), covariance
    kinds = [PoseErrors("since the start", travelled[later], *since_start)]
    begins, ends = distance_pairs(travelled, over_m)
    if len(begins):
        over = _between(T_true, T, covariance, begins, ends)
        kinds.append(PoseErrors(f"over {over_m:g} m", travelled[ends], *over))
    return tuple(kinds)


def distance_pairs(travelled_m: Array, over_m: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Pairs of poses so far apart along the path, each beginning where the last one ends."""
    marks = np.arange(0.0, travelled_m[-1] + 1e-9, over_m)
    index = np.searchsorted(travelled_m, marks)
    return index[:-1], index[1:]


def _between(
    T_true: Array, T: Array, covariance: Array | None, begins: NDArray[np.intp], ends: NDArray[np.intp]
) -> tuple[Array, Array | None]:
    """Errors of the motion between two poses, and what an odometry states for it.

    Its covariance grows by independent steps, so that of the motion is the difference of both poses', each
    in the axes of the second one. Where that is not positive definite, no NEES follows.
    """
    motion_true = invert(T_true[begins]) @ T_true[ends]
    motion = invert(T[:, begins]) @ T[:, ends]
    error = log_se3(invert(motion_true) @ motion)
    if covariance is None:
        return error, None
    return error, covariance[:, ends] - moved_covariance(invert(motion), covariance[:, begins])


def _poses(trajectory: Trajectory) -> Array:
    return transform(trajectory.position_m, trajectory.quat_xyzw)


def _rows(run: Run, stamp_ns: NDArray[np.int64]) -> Array:
    assert run.covariance is not None
    covariance: Array = run.covariance[np.searchsorted(run.estimate.stamp_ns, stamp_ns)]
    return covariance
