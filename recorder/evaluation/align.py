"""Aligns an estimate with the truth: rigidly, with scale, in position and yaw, or not at all."""

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from recorder.evaluation.trajectory import Trajectory


class Alignment(Enum):
    """Fits that are allowed before errors are measured."""

    NONE = "none"
    SE3 = "SE(3) Umeyama"
    SIM3 = "Sim(3) Umeyama"
    POSYAW = "position and yaw"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Similarity:
    """Maps estimated positions to true ones: y = scale · R x + t."""

    R: Array
    """Rotation, shape (3, 3)."""
    t: Array
    """Shift [m], shape (3,)."""
    scale: float = 1.0
    """Scale."""

    def apply(self, trajectory: Trajectory) -> Trajectory:
        """The trajectory in the world of the truth."""
        return replace(
            trajectory,
            position_m=self.scale * (trajectory.position_m @ self.R.T) + self.t,
            quat_xyzw=transforms.quat_multiply(transforms.matrix_to_quat(self.R), trajectory.quat_xyzw),
        )


def align(truth: Trajectory, estimate: Trajectory, alignment: Alignment) -> Similarity:
    """Best fit of the estimate to the truth in the least squares of positions.

    Args:
        truth: One pose per pair.
        estimate: Its partners.
        alignment: The allowed fit.

    Raises:
        EvaluationError: too few poses, or all on a point, so that the rotation is not determined.
    """
    if alignment is Alignment.NONE:
        return Similarity(R=np.eye(3), t=np.zeros(3))
    if len(truth) < 3:
        raise EvaluationError(
            f"'{estimate.name}' has {len(truth)} poses in common with the truth; alignment needs 3"
        )
    if alignment is Alignment.POSYAW:
        return _posyaw(truth, estimate)
    return umeyama(
        estimate.position_m, truth.position_m, with_scale=alignment is Alignment.SIM3, name=estimate.name
    )


def umeyama(x_m: Array, y_m: Array, *, with_scale: bool = False, name: str = "") -> Similarity:
    """Rotation, shift and scale that map x to y with the least squares.

    Umeyama, "Least-squares estimation of transformation parameters between two point patterns",
    IEEE TPAMI 13 (1991), equations 34–43. Points on a line leave the rotation about it open; no
    distance between partners depends on it.

    Args:
        x_m: Points [m], shape (N, 3).
        y_m: Their partners [m], shape (N, 3).
        with_scale: Whether the scale is fitted.
        name: Name of the points in an error.

    Raises:
        EvaluationError: the points do not spread.
    """
    mean_x, mean_y = x_m.mean(axis=0), y_m.mean(axis=0)
    dx, dy = x_m - mean_x, y_m - mean_y
    U, d, Vt = np.linalg.svd(dy.T @ dx / len(x_m))
    # A spread of rounding errors alone is a point.
    point_m = 64 * np.finfo(np.float64).eps * max(float(np.abs(x_m).max()), float(np.abs(y_m).max()))
    if not np.isfinite(d).all() or min(np.abs(dx).max(), np.abs(dy).max()) <= point_m:
        raise EvaluationError(
            f"the poses of '{name}' or the truth lie on a point; their alignment is not determined. "
            "Use a longer stretch or no alignment"
        )
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(U) * np.linalg.det(Vt))])
    R = (U * sign) @ Vt
    scale = float(np.sum(d * sign) / np.mean(np.sum(dx * dx, axis=1))) if with_scale else 1.0
    return Similarity(R=R, t=mean_y - scale * (R @ mean_x), scale=scale)


def fit_attitudes(truth: Trajectory, estimate: Trajectory) -> Array:
    """Rotation that lays the attitudes of an estimate over the true ones, shape (3, 3).

    Positions determine no roll about a straight path, attitudes do. It minimises the chordal distances of
    all pairs: Hartley et al., "Rotation averaging", IJCV 103 (2013), section 5.3.

    Args:
        truth: True poses, one per pair.
        estimate: Their partners.
    """
    true, estimated = (transforms.quat_to_matrix(t.quat_xyzw) for t in (truth, estimate))
    U, _, Vt = np.linalg.svd(np.einsum("nij,nkj->ik", true, estimated))
    R: Array = (U * [1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return R


def body_rotation(truth: Trajectory, estimate: Trajectory) -> Array:
    """Rotation R in R_estimate = R_truth · R that fits all pairs best, shape (3, 3).

    It lies between the body frames of an estimate and the truth, whatever the worlds, which are aligned.

    Args:
        truth: True poses, one per pair.
        estimate: Their partners, aligned.
    """
    return fit_attitudes(
        *(replace(one, quat_xyzw=transforms.quat_conjugate(one.quat_xyzw)) for one in (truth, estimate))
    )


def attitude_errors_deg(truth: Trajectory, estimate: Trajectory) -> Array:
    """Angles between true and estimated attitudes [deg] after `fit_attitudes`, shape (N,)."""
    R = fit_attitudes(truth, estimate)
    true, estimated = (transforms.quat_to_matrix(t.quat_xyzw) for t in (truth, estimate))
    rest = np.einsum("nji,njk->nik", true, R @ estimated)
    angles: Array = np.degrees(
        np.linalg.norm(transforms.quat_to_rotvec(transforms.matrix_to_quat(rest)), axis=-1)
    )
    return angles


def _posyaw(truth: Trajectory, estimate: Trajectory) -> Similarity:
    """Fit for systems that know the vertical (Zhang and Scaramuzza, IROS 2018, section V)."""
    mean_x, mean_y = estimate.position_m.mean(axis=0), truth.position_m.mean(axis=0)
    dx, dy = estimate.position_m - mean_x, truth.position_m - mean_y
    sine = float(np.sum(dx[:, 0] * dy[:, 1] - dx[:, 1] * dy[:, 0]))
    cosine = float(np.sum(dx[:, 0] * dy[:, 0] + dx[:, 1] * dy[:, 1]))
    if np.hypot(sine, cosine) <= 1e-12 * max(float(np.sum(dx * dx)), float(np.sum(dy * dy)), 1e-300):
        raise EvaluationError(
            f"the poses of '{estimate.name}' do not spread on the ground; their yaw is not determined. "
            "Use a longer stretch or no alignment"
        )
    yaw = np.arctan2(sine, cosine)
    R = transforms.quat_to_matrix(transforms.rpy_to_quat(0.0, 0.0, yaw))
    return Similarity(R=R, t=mean_y - R @ mean_x)


def position_error_m(truth: Trajectory, aligned: Trajectory) -> float:
    """Position error of pairs, RMSE [m]."""
    return float(np.sqrt(np.mean(np.sum((aligned.position_m - truth.position_m) ** 2, axis=1))))
