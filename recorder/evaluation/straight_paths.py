"""Decides whether positions determine the rotation of a path, and fits the roll about a straight one."""

from dataclasses import replace

import numpy as np

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from recorder.evaluation.align import position_error_m
from recorder.evaluation.trajectory import Trajectory

_NARROW, _LINE = 0.05, 1e-4
"""Width of a path, against its length, below which it is nearly straight, and below which it is a line."""
_ERROR_MIN = 0.02
"""Position errors above this part of the width turn an alignment by a degree and more."""
_STANDING_M = 0.5
"""Spread of a path along its direction below which the car hardly moved [m]."""


def rotation_is_open(truth: Trajectory, aligned: Trajectory) -> bool:
    """Whether a fit of positions leaves the rotation open: the car hardly moved, beside the errors.

    Args:
        truth: True poses, one per pair.
        aligned: Their partners, laid over them.
    """
    length = _extents(truth.position_m)[0][0]
    return length < _STANDING_M and position_error_m(truth, aligned) > _ERROR_MIN * length


def roll_is_open(truth: Trajectory, aligned: Trajectory) -> bool:
    """Whether a fit of positions leaves the roll about the path open: it is a line, or narrow beside errors.

    Args:
        truth: True poses, one per pair.
        aligned: Their partners, laid over them.
    """
    length, width = _extents(truth.position_m)[0]
    width = min(width, _extents(aligned.position_m)[0][1])
    error = position_error_m(truth, aligned)
    return width < _LINE * length or (width < _NARROW * length and error > _ERROR_MIN * width)


def rolled(truth: Trajectory, aligned: Trajectory) -> Trajectory:
    """The estimate with its attitudes turned about the true path so that they fit best: see `roll_turn`."""
    turn = roll_turn(truth, aligned)
    return replace(aligned, quat_xyzw=transforms.quat_multiply(turn, aligned.quat_xyzw))


def roll_turn(truth: Trajectory, aligned: Trajectory) -> Array:
    """Turn about the true path that fits an estimate's attitudes best, quaternion, shape (4,).

    The roll maximises Σ tr(R_truthᵀ R_roll R_est), the chordal measure of `fit_attitudes`, over turns about
    one axis.

    Args:
        truth: True poses, one per pair.
        aligned: Their partners, laid over them.
    """
    axis = _extents(truth.position_m)[1]
    true, estimated = (transforms.quat_to_matrix(t.quat_xyzw) for t in (truth, aligned))
    M = np.einsum("nij,nkj->ik", estimated, true)
    sine = float(np.sum(axis * (M[1, 2] - M[2, 1], M[2, 0] - M[0, 2], M[0, 1] - M[1, 0])))
    cosine = float(np.trace(M) - axis @ M @ axis)
    return transforms.rotvec_to_quat(np.arctan2(sine, cosine) * axis)


def _extents(position_m: Array) -> tuple[tuple[float, float], Array]:
    """Spread along a path and beside it [m], and its direction, shape (3,)."""
    from_mean = position_m - position_m.mean(axis=0)
    values, vectors = np.linalg.eigh(from_mean.T @ from_mean / len(position_m))
    spread = np.sqrt(np.maximum(values, 0.0))
    return (float(spread[2]), float(spread[1])), vectors[:, 2]
