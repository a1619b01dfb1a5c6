"""Errors of poses on SE(3), ξ = (translation [m], rotation [rad]) in T_estimate = T_true · exp(ξ).

Barfoot, State Estimation for Robotics (2nd edition 2024), chapter 8; Barfoot and Furgale, "Associating
uncertainty with three-dimensional poses for use in estimation problems", T-RO 30 (2014).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.transforms import invert, matrix_to_quat, quat_to_rotvec

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
