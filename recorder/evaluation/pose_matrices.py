"""Reads poses as KITTI's matrices: the upper three rows of each, or all four, row by row in a line."""

import logging
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.transforms import matrix_to_quat

_LOG = logging.getLogger(__name__)
_DEVIATION_MAX, _ROUNDING_MAX = 0.05, 1e-3


def matrix_place(sample: Array) -> int | None:
    """Column in which matrices begin, by what some rows, shape (N, M), hold; None: they hold none.

    Twelve or sixteen numbers, or a number or time before them.
    """
    count = sample.shape[1]
    if count not in (12, 13, 16, 17):
        return None
    begin = count % 4
    rows = sample[_finite(sample), begin:]
    R = rows.reshape(-1, count // 4, 4)[:, :3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        square = np.cbrt(np.linalg.det(R) ** 2)[:, None, None]
        like = np.abs(R @ R.transpose(0, 2, 1) - square * np.eye(3)).max(axis=(1, 2)) < 0.2 * square[:, 0, 0]
    if count >= 16:
        like &= np.abs(rows[:, 12:] - [0.0, 0.0, 0.0, 1.0]).max(axis=1) < 1e-6
    return begin if len(rows) and np.mean(like) > 0.5 else None


def poses_of(path: Path, matrices: Array) -> tuple[Array, Array]:
    """Positions [m], shape (N, 3), and quaternions xyzw, shape (N, 4), of matrices (N, 3, 4).

    Rows that are not finite stay so.

    Raises:
        EvaluationError: a matrix mirrors, scales or shears.
    """
    finite = _finite(matrices.reshape(len(matrices), -1))
    # Rows that are left out later need a rotation all the same.
    R = np.where(finite[:, None, None], matrices[:, :, :3], np.eye(3))
    with np.errstate(over="ignore", invalid="ignore"):
        deviation = np.nan_to_num(np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2)), nan=np.inf)
    worst = int(np.argmax(deviation))
    if deviation[worst] > _DEVIATION_MAX:
        raise EvaluationError(
            f"{path} holds a matrix that is no rotation (pose {worst + 1}: R R^T differs from 1 by "
            f"{deviation[worst]:.2g}); give rotations without scale"
        )
    if np.any(mirrored := np.linalg.det(R) < 0):
        raise EvaluationError(
            f"{path} is left-handed: the matrix of pose {np.flatnonzero(mirrored)[0] + 1} mirrors "
            "(determinant below 0); negate one axis of the world and the same one of the body"
        )
    if deviation[worst] > _ROUNDING_MAX:
        _LOG.warning(
            "%s: R R^T differs from 1 by up to %.2g; the nearest rotations are taken", path, deviation[worst]
        )
    U, _, Vt = np.linalg.svd(R)
    quat = matrix_to_quat(U @ Vt)
    return matrices[:, :, 3], np.where(finite[:, None], quat, np.nan)


def _finite(rows: Array) -> NDArray[np.bool_]:
    finite: NDArray[np.bool_] = np.all(np.isfinite(rows), axis=1)
    return finite
