"""NEES, coverage and the factor by which stated covariances are wrong, with confidence bounds.

Runs are independent of each other and the poses of one run are not, so that every bound counts runs.
Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation (2001), section 5.4.

Errors of an estimator's runs over one drive: of each pose since the first one, and over a fixed distance.

Odometry drifts: an error at the end of a drive is mostly that of its first turns. So the error over a fixed
distance is measured beside it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.transforms import invert, transform
from recorder.evaluation.associate import Association, associate
from recorder.evaluation.confidence import CONFIDENCE, Interval, mean_interval, wilson
from recorder.evaluation.se3 import log_se3, moved_covariance
from recorder.evaluation.trajectory import Trajectory

LEVELS = (0.5, 0.9, 0.95)
"""Probabilities of the ellipsoids whose coverage is counted."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Consistency:
    """How stated covariances compare with errors, of S runs at P poses, in D dimensions."""

    nees: Array
    """Normalised error squared ξᵀ Σ⁻¹ ξ, shape (S, P); NaN where a covariance is not positive definite."""
    anees: Array
    """Mean over runs, D where covariances are right, shape (P,)."""
    bounds: Array
    """Between which `anees` lies at `CONFIDENCE` if covariances are right, (low, high)."""
    within: float
    """Share of poses at which it does; 0.95 if covariances are right."""
    scale: Interval
    """Factor by which covariances are too small (above 1) or too large: mean NEES by D."""
    noise_scale: Interval
    """The same of the scatter about the mean of the runs: without the error that all runs share."""
    axis_scale: Array
    """Factor of each variance by itself, shape (D,)."""
    coverage: dict[float, Interval]
    """Share of errors inside the ellipsoid of each of `LEVELS`; Wilson's bounds, a run being one trial."""


def consistency_of(errors: Array, covariances: Array) -> Consistency:
    """Compare errors with the covariances that were stated for them.

    Args:
        errors: Of S runs at P poses, shape (S, P, D).
        covariances: Stated for them, shape (S, P, D, D).
    """
    runs, _, dimensions = errors.shape
    whitened = _whitened(errors, covariances)
    nees = np.sum(whitened**2, axis=-1)
    anees = nees.mean(axis=0)
    bounds = anees_bounds(runs, dimensions)
    known = np.isfinite(anees)
    scatter = np.full(runs, np.nan)
    if runs > 1:
        apart = _whitened(errors - errors.mean(axis=0), covariances)
        # The mean is the runs' own: it takes a degree of freedom.
        scatter = np.sum(apart**2, axis=-1)[:, known].mean(axis=1) * runs / (runs - 1)
    variances = np.diagonal(covariances, axis1=-2, axis2=-1)[:, known]
    inside = {level: np.asarray(nees[:, known] <= chi2.ppf(level, dimensions)) for level in LEVELS}
    return Consistency(
        nees=nees,
        anees=anees,
        bounds=bounds,
        within=float(np.mean((anees[known] >= bounds[0]) & (anees[known] <= bounds[1]))),
        scale=mean_interval(nees[:, known].mean(axis=1) / dimensions),
        noise_scale=mean_interval(scatter / dimensions),
        axis_scale=np.mean(errors[:, known] ** 2 / variances, axis=(0, 1)),
        coverage={level: wilson(float(found.mean()), runs) for level, found in inside.items()},
    )


def anees_bounds(runs: int, dimensions: int) -> Array:
    """Bounds of the mean NEES of independent runs: runs × mean is χ² with runs × dimensions."""
    tail = 0.5 * (1.0 - CONFIDENCE)
    return np.asarray(chi2.ppf([tail, 1.0 - tail], runs * dimensions)) / runs


def _whitened(errors: Array, covariances: Array) -> Array:
    """Errors in units of their covariances' axes, NaN where these are not positive, shape (S, P, D)."""
    values, vectors = np.linalg.eigh(covariances)
    # Against rounding: what a difference of covariances has left is no variance.
    whole = values[..., 0] > 1e-12 * values[..., -1]
    root = np.sqrt(np.where(whole[..., None], values, np.nan))
    found: Array = np.einsum("spij,spi->spj", vectors, errors) / root
    return found


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
    T = np.stack([_poses(_some(run.estimate, common)) for run in runs])
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
    found = [PoseErrors("since the start", travelled[later], *since_start)]
    begins, ends = distance_pairs(travelled, over_m)
    if len(begins):
        over = _between(T_true, T, covariance, begins, ends)
        found.append(PoseErrors(f"over {over_m:g} m", travelled[ends], *over))
    return tuple(found)


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


def _some(trajectory: Trajectory, stamp_ns: NDArray[np.int64]) -> Trajectory:
    return trajectory.take(np.searchsorted(trajectory.stamp_ns, stamp_ns))


def _rows(run: Run, stamp_ns: NDArray[np.int64]) -> Array:
    assert run.covariance is not None
    found: Array = run.covariance[np.searchsorted(run.estimate.stamp_ns, stamp_ns)]
    return found
