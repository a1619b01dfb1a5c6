"""Errors of an aligned estimate, each by its own definition and under its own name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array, Index
from recorder.evaluation.trajectory import Trajectory

KITTI_LENGTHS_M = (50.0, 100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0)
"""KITTI's lengths [m], and 50 m for short routes."""


class Metric(Enum):
    """An error per pose or per pair of consecutive poses; the value is its label."""

    APE_TRANSLATION = "APE, position: |p_est - p_truth| (paper; evo translation_part)"
    APE_ROTATION = "APE, rotation: angle of R_truth^T R_est (evo angle_deg)"
    RPE_PAPER = "RPE, paper: |dp_est - dp_truth|, world-frame steps of consecutive stamps"
    RPE_TRANSLATION = "RPE, evo translation_part: |trans(Q_rel^-1 P_rel)|"
    RPE_POINT_DISTANCE = "RPE, evo point_distance: ||dp_est| - |dp_truth||"
    RPE_ROTATION = "RPE, rotation: angle of Q_rel^-1 P_rel (evo angle_deg)"

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return "deg" if self in (Metric.APE_ROTATION, Metric.RPE_ROTATION) else "m"


OF_POSITIONS = (Metric.APE_TRANSLATION, Metric.RPE_PAPER, Metric.RPE_POINT_DISTANCE)
"""Metrics that need no attitudes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Statistics:
    """Summary of errors, in the unit of the metric."""

    rmse: float
    """Root of the mean square."""
    mean: float
    """Mean."""
    median: float
    """Median."""
    std: float
    """Standard deviation."""
    min: float
    """Smallest."""
    max: float
    """Largest."""

    @classmethod
    def of(cls, values: Array) -> Statistics:
        """Summary of at least one value."""
        return cls(
            rmse=float(np.sqrt(np.mean(values**2))),
            mean=float(np.mean(values)),
            median=float(np.median(values)),
            std=float(np.std(values)),
            min=float(np.min(values)),
            max=float(np.max(values)),
        )


def errors(metric: Metric, truth: Trajectory, estimate: Trajectory, *, delta: int = 1) -> Array:
    """Errors of paired poses.

    Args:
        metric: Definition of the error.
        truth: One pose per pair.
        estimate: Its partners, aligned.
        delta: Poses from one end of a step to the other, for relative metrics.

    Returns:
        Absolute metrics: one value per pose; relative ones: one per step, stored at its end; in
        the metric's unit.
    """
    if metric is Metric.APE_TRANSLATION:
        return _norm(estimate.position_m - truth.position_m)
    if metric is Metric.APE_ROTATION:
        return _angle_deg(truth.quat_xyzw, estimate.quat_xyzw)
    if delta > 1:
        index = np.arange(0, len(truth), delta)
        truth, estimate = truth.take(index), estimate.take(index)
    step_truth, step_estimate = np.diff(truth.position_m, axis=0), np.diff(estimate.position_m, axis=0)
    if metric is Metric.RPE_PAPER:
        return _norm(step_estimate - step_truth)
    if metric is Metric.RPE_POINT_DISTANCE:
        return np.abs(_norm(step_estimate) - _norm(step_truth))
    before, after = slice(None, -1), slice(1, None)
    moved_truth, turn_truth = _steps(truth, before, after)
    moved_estimate, turn_estimate = _steps(estimate, before, after)
    if metric is Metric.RPE_TRANSLATION:
        # |Q_rel^-1 P_rel| of the translations: the rotation of Q_rel does not change the length.
        return _norm(moved_estimate - moved_truth)
    return _angle_deg(turn_truth, turn_estimate)


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentError:
    """Mean drift over segments of one length, as the KITTI odometry benchmark defines it."""

    length_m: float
    """Length of the segments along the true path [m]."""
    translation_percent: float
    """Mean translation error [% of the length]."""
    rotation_deg_per_m: float
    """Mean rotation error [deg/m]."""
    segments: int
    """Number of segments."""


def segment_errors(
    truth: Trajectory, estimate: Trajectory, lengths_m: Sequence[float] = KITTI_LENGTHS_M, *, every: int = 10
) -> tuple[SegmentError, ...]:
    """Drift over segments that start at every tenth pose; lengths without a segment are left out."""
    step = _norm(np.diff(truth.position_m, axis=0))
    travelled = np.concatenate([[0.0], np.cumsum(step)])
    starts = np.arange(0, len(truth), every)
    segments: list[SegmentError] = []
    for length in lengths_m:
        ends = np.searchsorted(travelled, travelled[starts] + length, side="right")
        a, b = starts[ends < len(truth)], ends[ends < len(truth)]
        if not len(a):
            continue
        moved_truth, turn_truth = _steps(truth, a, b)
        moved_estimate, turn_estimate = _steps(estimate, a, b)
        segments.append(
            SegmentError(
                length_m=length,
                translation_percent=float(np.mean(_norm(moved_estimate - moved_truth)) / length * 100.0),
                rotation_deg_per_m=float(np.mean(_angle_deg(turn_truth, turn_estimate)) / length),
                segments=len(a),
            )
        )
    return tuple(segments)


def _norm(vectors: Array) -> Array:
    result: Array = np.sqrt(np.einsum("...i,...i->...", vectors, vectors))
    return result


def _angle_deg(a_xyzw: Array, b_xyzw: Array) -> Array:
    turn = transforms.quat_multiply(transforms.quat_conjugate(a_xyzw), b_xyzw)
    return np.degrees(_norm(transforms.quat_to_rotvec(turn)))


def _steps(trajectory: Trajectory, first: Index | slice, last: Index | slice) -> tuple[Array, Array]:
    """Shifts and turns from some poses to others, in the frames of the first."""
    back = transforms.quat_conjugate(trajectory.quat_xyzw[first])
    shift = trajectory.position_m[last] - trajectory.position_m[first]
    return transforms.quat_rotate(back, shift), transforms.quat_multiply(back, trajectory.quat_xyzw[last])
