"""Poses as a file holds them, put in the order of their times."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from recorder.evaluation.trajectory import Trajectory

_POSITION_MAX_M = 1e9
"""Positions beyond are no trajectory of this world [m]."""
_RUN_STEPS, _RUN_POSES = 10, 10
"""A run begins where stamps jump back by more than so many steps, after at least so many poses on average."""
_LOG = logging.getLogger(__name__)


def in_order(path: Path, stamp_ns: NDArray[np.int64], position_m: Array, quat_xyzw: Array) -> Trajectory:
    """The trajectory of what a file holds.

    Poses that are not finite are left out, others sorted, of poses of one time the last one counts; each
    with a warning.

    Raises:
        EvaluationError: no pose is finite, a quaternion is far from unit length, or the file holds two runs.
    """
    finite: NDArray[np.bool_] = np.all(np.isfinite(np.hstack([position_m, quat_xyzw])), axis=1)
    if not finite.any():
        raise EvaluationError(f"{path} holds only poses that are not finite")
    if not finite.all():
        lost = len(finite) - int(finite.sum())
        _LOG.warning("%s: %d of %d poses are not finite; left out", path, lost, len(finite))
        stamp_ns, position_m, quat_xyzw = stamp_ns[finite], position_m[finite], quat_xyzw[finite]
    if not np.all(np.abs(position_m) < _POSITION_MAX_M):
        raise EvaluationError(f"{path} holds a position beyond {_POSITION_MAX_M:g} m; give metres")
    with np.errstate(over="ignore"):
        norm = np.sqrt(np.sum(quat_xyzw**2, axis=1, keepdims=True))
    if not np.all(wrong := np.abs(norm - 1.0) < 0.01):
        raise EvaluationError(
            f"{path} holds a quaternion that is not of length 1 (pose {int(np.argmin(wrong)) + 1}); "
            "name its columns in a header"
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
