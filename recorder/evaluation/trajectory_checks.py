"""Makes a trajectory of the poses that a file holds: sorts them, and refuses damaged ones."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from recorder.evaluation.trajectory import Trajectory

_LOG = logging.getLogger(__name__)
_POSITION_MAX_M = 1e9
"""Positions beyond are no trajectory of this world [m]."""
_LENGTH_MIN_M, _WIDTH_MIN = 1.0, 0.05
"""A path of this spread [m], and of this part of it beside its direction, turns."""
_SPIKE_M, _SPIKE_STEPS = 1.0, 10.0
"""A pose that is farther from both its neighbours, also in usual steps, is impossible if these are close."""
_RUN_STEPS, _RUN_POSES = 10, 10
"""A run begins where stamps jump back by more than so many steps, after at least so many poses on average."""


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
    finite = _whole_rows(np.isfinite(np.hstack([position_m, quat_xyzw])))
    if not finite.any():
        raise EvaluationError(f"{path} holds only poses that are not finite")
    rows = np.flatnonzero(finite)
    if not finite.all():
        lost = len(finite) - int(finite.sum())
        _LOG.warning("%s: %d of %d poses are not finite; left out", path, lost, len(finite))
        stamp_ns, position_m, quat_xyzw = stamp_ns[finite], position_m[finite], quat_xyzw[finite]
    if not (within := _whole_rows(np.abs(position_m) < _POSITION_MAX_M)).all():
        where = place(int(rows[np.argmin(within)]))
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


def _whole_rows(table: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Rows that are true throughout; NumPy takes long for many short rows, and mostly all of them are."""
    return np.ones(len(table), np.bool_) if table.all() else np.all(table, axis=1)


def _are_none(quat_xyzw: Array, position_m: Array) -> bool:
    """Whether attitudes are all missing or zero, or all the same although the path turns."""
    given = quat_xyzw[_whole_rows(np.isfinite(quat_xyzw))]
    if len(given) and np.ptp(given[:: 1 + len(given) // 1000], axis=0).max() > 1e-9:
        return False
    path_m = position_m[_whole_rows(np.abs(position_m) < _POSITION_MAX_M)]
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
    spikes = np.flatnonzero(away_m > max(_SPIKE_M, _SPIKE_STEPS * float(np.median(steps_m))))
    beside_m = np.linalg.norm(position_m[spikes + 2] - position_m[spikes], axis=1)
    spikes = spikes[beside_m < 0.2 * away_m[spikes]]
    if not len(spikes):
        return ()
    others = f", and {len(spikes) - 1} more like it" if len(spikes) > 1 else ""
    where, far_m = place(int(spikes[0]) + 1), away_m[spikes[0]]
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
