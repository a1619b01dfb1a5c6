"""Scores an estimated trajectory against the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from carlaloc_env.core.errors import EvaluationError
from recorder.evaluation.align import Alignment, align, attitude_errors_deg
from recorder.evaluation.associate import MAX_GAP_NS, Association, CoveredTime, associate
from recorder.evaluation.evaluation_result import EvaluationResult
from recorder.evaluation.findings import findings_of
from recorder.evaluation.metrics import OF_POSITIONS, Metric, Statistics, errors, segment_errors
from recorder.evaluation.straight_paths import roll_is_open, rolled, rotation_is_open
from recorder.evaluation.trajectory import Trajectory


def evaluate(
    truth: Trajectory,
    estimate: Trajectory,
    *,
    alignment: Alignment = Alignment.SE3,
    association: Association = Association.NEAREST,
    max_gap_ns: int = MAX_GAP_NS,
    T_body_sensor: ArrayLike | None = None,
    time_offset_ns: int = 0,
    expected: int | None = None,
    delta: int = 1,
    metrics: Sequence[Metric] = tuple(Metric),
) -> EvaluationResult:
    """Errors of an estimate.

    Args:
        truth: True poses of the body.
        estimate: A system's poses of its own frame.
        alignment: Fit before errors are measured.
        association: How poses are paired.
        max_gap_ns: Longest time between two poses of a pair [ns].
        T_body_sensor: Maps the frame that the estimate is of to the truth's body, shape (4, 4); no
            alignment can make up for a missing lever arm. None: both are of the same frame.
        time_offset_ns: Added to the estimate's stamps [ns], e.g. −50 ms for a system that stamps the
            beginning of a sweep with the time of its end.
        expected: Poses that the system should have given; None: as many as its median interval fits
            into the time of the truth, or those that it gave.
        delta: Poses from one end of a step to the other, for relative metrics.
        metrics: Kinds of errors to measure; without attitudes, those of them that need none.

    Raises:
        EvaluationError: too few pairs, or an alignment that is not determined.
    """
    if delta < 1:
        raise EvaluationError(f"delta of {delta} poses; give 1 or more")
    moved = truth if T_body_sensor is None else truth.of_sensor(T_body_sensor)
    shifted = estimate.shifted(time_offset_ns)
    true, paired = associate(moved, shifted, association, max_gap_ns=max_gap_ns)
    if len(true) <= delta:
        raise EvaluationError(
            f"'{estimate.name}' has {len(true)} poses in common with the truth; needs more than {delta}"
        )
    transform = align(true, paired, alignment)
    aligned = transform.apply(paired)
    has_attitudes = true.has_attitudes and aligned.has_attitudes
    if not has_attitudes:
        metrics = [metric for metric in metrics if metric in OF_POSITIONS]
    roll_open = alignment in (Alignment.SE3, Alignment.SIM3) and has_attitudes and roll_is_open(true, aligned)
    values = {metric: errors(metric, true, aligned, delta=delta) for metric in metrics}
    hardly_moved = alignment is not Alignment.NONE and rotation_is_open(true, aligned)
    if hardly_moved and Metric.APE_ROTATION in values:
        values[Metric.APE_ROTATION] = attitude_errors_deg(true, aligned)
    elif roll_open and Metric.APE_ROTATION in values:
        values[Metric.APE_ROTATION] = errors(Metric.APE_ROTATION, true, rolled(true, aligned))
    result = EvaluationResult(
        truth=true,
        estimate=aligned,
        alignment=alignment,
        association=association,
        transform=transform,
        expected=max(len(true), _expected(truth, estimate, association))
        if expected is None
        else max(expected, 1),
        covered=CoveredTime.of(moved, shifted, true.stamp_ns),
        values=values,
        statistics={metric: Statistics.of(v) for metric, v in values.items()},
        segments=segment_errors(true, aligned) if has_attitudes else (),
        roll_from_attitudes=roll_open,
    )
    return replace(result, findings=tuple(findings_of(result, moved, shifted, hardly_moved=hardly_moved)))


def _expected(truth: Trajectory, estimate: Trajectory, association: Association) -> int:
    # Whole intervals: a system that gives a pose at the end of each sweep has none at the beginning.
    interval_s = float(np.median(np.diff(estimate.stamp_ns))) * 1e-9 if len(estimate) > 1 else 0.0
    count = int(truth.duration_s / interval_s + 0.001) if interval_s > 0 else 1
    # Only between true poses there are more pairs than true poses.
    return count if association is Association.INTERPOLATED else min(count, len(truth))
