"""Scores an estimated trajectory against the truth, and names causes of errors in files and settings.

When an estimate counts as failed; the paper prints "fail" without a rule, so here is one.

Position errors of an estimate along its path, kept so that it need not be evaluated again.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.files.atomic_files import atomic_write
from recorder.evaluation.align import (
    Alignment,
    Similarity,
    align,
    attitude_errors_deg,
    body_rotation,
    position_error_m,
    roll_is_open,
    rolled,
    rotation_is_open,
    umeyama,
)
from recorder.evaluation.associate import (
    MAX_GAP_NS,
    Association,
    CoveredTime,
    associate,
    clock_name,
    find_time_offset,
)
from recorder.evaluation.metrics import (
    OF_POSITIONS,
    Metric,
    SegmentError,
    Statistics,
    errors,
    segment_errors,
)
from recorder.evaluation.trajectory import Trajectory


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EvaluationResult:
    """Errors of one estimate, and the settings that led to them."""

    truth: Trajectory
    """True poses, one per pair."""
    estimate: Trajectory
    """Their partners, aligned."""
    alignment: Alignment
    """Fit over all pairs that lays the estimate over the truth."""
    association: Association
    """How pairs were found."""
    transform: Similarity
    """The fit."""
    expected: int
    """Poses that the system should have given over the time of the truth."""
    covered: CoveredTime
    """How much of the time has pairs."""
    values: Mapping[Metric, NDArray[np.float64]]
    """Errors per pose, or per step between consecutive poses."""
    statistics: Mapping[Metric, Statistics]
    """Their summaries."""
    segments: tuple[SegmentError, ...]
    """Drift over segments of the path (KITTI)."""
    roll_from_attitudes: bool = False
    """Whether the path is so straight that positions leave the roll about it open: the absolute rotation
    error is that after the roll which fits attitudes best."""
    findings: tuple[str, ...] = ()
    """Causes of errors that lie in the files or the settings, a line each, with the cure."""

    @property
    def matched(self) -> int:
        """Number of pairs."""
        return len(self.truth)

    @property
    def coverage(self) -> float:
        """Pairs found, as a fraction of those expected, 0–1."""
        return min(1.0, self.matched / self.expected)

    def to_mapping(self) -> dict[str, Any]:
        """The result as JSON values, without the single errors."""
        return {
            "truth": self.truth.name,
            "estimate": self.estimate.name,
            "alignment": self.alignment.value,
            "roll_from_attitudes": self.roll_from_attitudes,
            "association": self.association.value,
            "matched": self.matched,
            "expected": self.expected,
            "coverage": self.coverage,
            "covered_time": asdict(self.covered),
            "findings": list(self.findings),
            "transform": {
                "R": self.transform.R.tolist(),
                "t_m": self.transform.t.tolist(),
                "scale": self.transform.scale,
            },
            "metrics": {
                metric.name.lower(): {"label": metric.value, "unit": metric.unit, **asdict(statistics)}
                for metric, statistics in self.statistics.items()
            },
            "segments": [asdict(segment) for segment in self.segments],
        }


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
    return replace(result, findings=tuple(_findings(result, moved, shifted, hardly_moved=hardly_moved)))


_CAUSE = 0.4
"""A cause is named if the error without it is below this part of the error, and of a standing estimate's."""
_TURN_DEG, _SCALE, _OFFSET_S, _TIME = 3.0, 0.1, 0.005, 0.95
"""Least rotation [deg], change of scale and offset [s] that are named; coverage below which gaps are."""


def _findings(
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
        yield from _body_findings(result)
        yield from _scale_findings(result)
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
        offset_ns = find_time_offset(truth, estimate, result.alignment)
        true, paired = associate(
            truth, estimate.shifted(offset_ns), Association.INTERPOLATED,
            max_gap_ns=2 * int(np.median(np.diff(truth.stamp_ns))),
        )  # fmt: skip
        error_m = position_error_m(true, align(true, paired, result.alignment).apply(paired))
        enough = len(true) >= 0.8 * result.matched
        if enough and abs(offset_ns) * 1e-9 > _OFFSET_S and _explains(result, error_m):
            offset_s = offset_ns / 1e9
            yield (
                f"a constant offset of {offset_s:+.3f} s of the estimate's clock{clock_name(offset_s)} "
                f"explains most of the error ({_instead(result, error_m)}); "
                f"evaluate --time-offset={offset_s:.3f} takes it out"
            )


def _explains(result: EvaluationResult, error_m: float) -> bool:
    return error_m < _CAUSE * min(position_error_m(result.truth, result.estimate), standing_error_m(result))


def _instead(result: EvaluationResult, error_m: float) -> str:
    return f"APE {error_m:.3g} m in place of {position_error_m(result.truth, result.estimate):.3g} m"


def _expected(truth: Trajectory, estimate: Trajectory, association: Association) -> int:
    # Whole intervals: a system that gives a pose at the end of each sweep has none at the beginning.
    interval_s = float(np.median(np.diff(estimate.stamp_ns))) * 1e-9 if len(estimate) > 1 else 0.0
    count = int(truth.duration_s / interval_s + 0.001) if interval_s > 0 else 1
    # Only between true poses there are more pairs than true poses.
    return count if association is Association.INTERPOLATED else min(count, len(truth))


@dataclass(frozen=True, slots=True, kw_only=True)
class FailRule:
    """Bounds that an estimate has to keep.

    A run fails when its process ends with an error or passes its time limit, when it covers too little of
    the sequence, or when it has diverged: when its position error is more than half of what an estimate
    that never moves has, so that it shows little of where the car was.
    """

    coverage_min: float = 0.8
    """Least share of the expected poses, and of the time, 0–1; initialisation counts as missing."""
    ape_of_standing: float = 0.5
    """Largest position error, as a share of what an estimate that stands at the best place has."""
    ape_small_m: float = 0.1
    """Position errors below this never count as diverged: in a stretch at a red light nothing moves [m]."""

    def why_failed(self, result: EvaluationResult) -> str | None:
        """Why the estimate counts as failed, in a few words; None: it does not.

        Args:
            result: With `Metric.APE_TRANSLATION`.
        """
        if result.coverage < self.coverage_min:
            return f"covers {result.coverage:.0%} of the sequence, less than {self.coverage_min:.0%}"
        if result.covered.share < self.coverage_min:
            return f"covers {result.covered}; {self.coverage_min:.0%} is the least"
        standing_m = standing_error_m(result)
        ape_m = result.statistics[Metric.APE_TRANSLATION].rmse
        if ape_m >= max(self.ape_of_standing * standing_m, self.ape_small_m):
            return f"diverged: APE {ape_m:.2f} m, an estimate that never moves has {standing_m:.2f} m"
        return None


def standing_error_m(result: EvaluationResult) -> float:
    """Position error (RMSE) of an estimate that stands at the mean of the true positions [m]."""
    away = result.truth.position_m - result.truth.position_m.mean(axis=0)
    return float(np.sqrt(np.mean(np.einsum("ij,ij->i", away, away))))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathErrors:
    """An estimate behind its fit, the truth, and how far they are apart, pose by pose."""

    name: str
    """Name of the estimate."""
    stamp_ns: NDArray[np.int64]
    """Times [ns], shape (N,)."""
    truth_m: Array
    """True positions [m], shape (N, 3)."""
    estimate_m: Array
    """Estimated positions behind the fit [m], shape (N, 3)."""
    error_m: Array
    """Distances between both [m], shape (N,)."""

    @staticmethod
    def of(result: EvaluationResult, name: str | None = None) -> PathErrors:
        """Errors of an evaluated estimate.

        Args:
            result: With `Metric.APE_TRANSLATION`.
            name: Another name than the estimate's own.
        """
        return PathErrors(
            name=result.estimate.name if name is None else name,
            stamp_ns=result.estimate.stamp_ns,
            truth_m=result.truth.position_m,
            estimate_m=result.estimate.position_m,
            error_m=result.values[Metric.APE_TRANSLATION],
        )

    @property
    def way_m(self) -> Array:
        """Distance travelled since the first pose [m], shape (N,)."""
        steps = np.linalg.norm(np.diff(self.truth_m, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def save(self, path: Path) -> None:
        """Write them to a new file (.npz)."""
        with atomic_write(path, EvaluationError) as part, part.open("wb") as file:
            np.savez_compressed(file, **{field.name: getattr(self, field.name) for field in fields(self)})

    @staticmethod
    def load(path: Path) -> PathErrors:
        """Read a file that `save` wrote.

        Raises:
            EvaluationError: it cannot be read.
        """
        try:
            with np.load(path) as found:
                return PathErrors(**{**found, "name": str(found["name"])})
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise EvaluationError(f"cannot read {path} ({error}); evaluate the estimate again") from error
