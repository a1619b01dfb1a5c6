"""Names causes of errors that lie in files or settings: frames, scales, clocks."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np

from carlaloc_env.core import transforms
from carlaloc_env.core.errors import EvaluationError
from recorder.evaluation.align import Alignment, body_rotation, position_error_m, umeyama
from recorder.evaluation.associate import clock_name
from recorder.evaluation.evaluation_result import EvaluationResult
from recorder.evaluation.fail_rule import standing_error_m
from recorder.evaluation.metrics import Metric, Statistics, errors
from recorder.evaluation.straight_paths import rolled
from recorder.evaluation.time_offset import error_at, find_time_offset
from recorder.evaluation.trajectory import Trajectory

_CAUSE = 0.4
"""A cause is named if the error without it is below this part of the error, and of a standing estimate's."""
_TURN_DEG, _SCALE, _OFFSET_S, _TIME = 3.0, 0.1, 0.005, 0.95
"""Least rotation [deg], change of scale and offset [s] that are named; coverage below which gaps are."""
_CLOCK_S = 0.05
"""Time between the poses by whose motions clocks are compared, where there are as many [s]."""
_SAMPLE = 10_000
"""Pairs from which rotations and scales are fitted; an hour at 200 Hz has 72 times as many."""


def findings_of(
    result: EvaluationResult, truth: Trajectory, estimate: Trajectory, *, hardly_moved: bool
) -> Iterator[str]:
    """Lines of `EvaluationResult.findings`; truth and estimate are those before pairing."""
    yield from (*truth.notes, *estimate.notes)
    for one in (truth, estimate):
        if not one.has_attitudes:
            yield f"'{one.name}' has positions, but no attitudes that change: rotation errors are left out"
    if result.covered.share < _TIME:
        yield f"pairs cover {result.covered}"
    if hardly_moved:
        path_m = result.truth.length_m
        yield f"'{truth.name}' hardly moves ({path_m:.2g} m): its rotation error is after a fit of attitudes"
    else:
        rows = np.arange(0, result.matched, max(1, result.matched // _SAMPLE))
        sample = replace(result, truth=result.truth.take(rows), estimate=result.estimate.take(rows))
        yield from _body_findings(sample)
        yield from _scale_findings(sample)
        yield from _clock_findings(result, truth, estimate)


def _body_findings(result: EvaluationResult) -> Iterator[str]:
    """A constant rotation between the body frames, where positions fit."""
    truth, estimate = result.truth, result.estimate
    fits = position_error_m(truth, estimate) < _CAUSE * standing_error_m(result)
    if not (fits and truth.has_attitudes and estimate.has_attitudes):
        return
    estimate = rolled(truth, estimate) if result.roll_from_attitudes else estimate
    R = body_rotation(truth, estimate)
    quat = transforms.matrix_to_quat(R)
    angle_deg = float(np.degrees(np.linalg.norm(transforms.quat_to_rotvec(quat))))
    turned = truth.of_sensor(transforms.from_rotation(R))
    before, after = (Statistics.of(errors(Metric.APE_ROTATION, t, estimate)).rmse for t in (truth, turned))
    if angle_deg > _TURN_DEG and after < _CAUSE * before:
        turn = ",".join(f"{round(float(a), 1) + 0.0:g}" for a in np.degrees(transforms.quat_to_rpy(quat)))
        yield (
            f"a constant rotation of {angle_deg:.1f}° lies between the body frames of '{estimate.name}' and "
            f"'{truth.name}'; evaluate --estimate-to-truth={turn} (roll, pitch, yaw [deg]), auto or the "
            "extrinsic X,Y,Z,QX,QY,QZ,QW takes it out"
        )


def _scale_findings(result: EvaluationResult) -> Iterator[str]:
    """A scale far from 1, fitted or not."""
    if result.alignment is Alignment.SIM3:
        if abs(np.log(result.transform.scale)) > _SCALE:
            yield f"the fitted scale is {result.transform.scale:.4g}: the estimate is not in metres"
        return
    truth, estimate = result.truth, result.estimate
    with suppress(EvaluationError):
        fit = umeyama(estimate.position_m, truth.position_m, with_scale=True)
        error_m = position_error_m(truth, fit.apply(estimate))
        if fit.scale > 0 and abs(np.log(fit.scale)) > _SCALE and _explains(result, error_m):
            yield (
                f"a scale of {fit.scale:.4g} explains most of the error ({_instead(result, error_m)}); "
                "evaluate --align sim3 fits it"
            )


def _clock_findings(result: EvaluationResult, truth: Trajectory, estimate: Trajectory) -> Iterator[str]:
    """A constant offset of the estimate's clock."""
    with suppress(EvaluationError):
        offset_ns = find_time_offset(_thinned(truth), _thinned(estimate), result.alignment)
        if abs(offset_ns) * 1e-9 <= _OFFSET_S:
            return
        error_m, pairs = error_at(truth, estimate, offset_ns, result.alignment)
        if pairs >= 0.8 * result.matched and _explains(result, error_m):
            offset_s = offset_ns / 1e9
            yield (
                f"a constant offset of {offset_s:+.3f} s of the estimate's clock{clock_name(offset_s)} "
                f"explains most of the error ({_instead(result, error_m)}); "
                f"evaluate --time-offset={offset_s:.3f} takes it out"
            )


def _thinned(trajectory: Trajectory) -> Trajectory:
    """Poses about `_CLOCK_S` apart."""
    period_s = trajectory.duration_s / max(len(trajectory) - 1, 1)
    return trajectory.take(np.arange(0, len(trajectory), max(1, int(_CLOCK_S / max(period_s, 1e-9)))))


def _explains(result: EvaluationResult, error_m: float) -> bool:
    return error_m < _CAUSE * min(position_error_m(result.truth, result.estimate), standing_error_m(result))


def _instead(result: EvaluationResult, error_m: float) -> str:
    return f"APE {error_m:.3g} m in place of {position_error_m(result.truth, result.estimate):.3g} m"
