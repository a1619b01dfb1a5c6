"""Scores an estimated trajectory against the truth.

When an estimate counts as failed; the paper prints "fail" without a rule, so here is one.

Position errors of an estimate along its path, kept so that it need not be evaluated again.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.files.output_paths import atomic_write
from recorder.evaluation.align import Alignment, Similarity, align, roll_is_open, rolled
from recorder.evaluation.associate import MAX_GAP_NS, Association, associate
from recorder.evaluation.metrics import Metric, SegmentError, Statistics, errors, segment_errors
from recorder.evaluation.trajectory import Trajectory

_LOG = logging.getLogger(__name__)


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
    values: Mapping[Metric, NDArray[np.float64]]
    """Errors per pose, or per step between consecutive poses."""
    statistics: Mapping[Metric, Statistics]
    """Their summaries."""
    segments: tuple[SegmentError, ...]
    """Drift over segments of the path (KITTI)."""
    roll_from_attitudes: bool = False
    """Whether the path is so straight that positions leave the roll about it open: the absolute rotation
    error is that after the roll which fits attitudes best."""

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
        metrics: Kinds of errors to measure.

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
    roll_open = alignment in (Alignment.SE3, Alignment.SIM3) and roll_is_open(true, aligned)
    values = {metric: errors(metric, true, aligned, delta=delta) for metric in metrics}
    if roll_open and Metric.APE_ROTATION in values:
        _LOG.warning(
            "the path of '%s' is nearly straight: the alignment leaves the roll about it open, so the "
            "rotation error is that after the roll that fits attitudes best", truth.name,
        )  # fmt: skip
        values[Metric.APE_ROTATION] = errors(Metric.APE_ROTATION, true, rolled(true, aligned))
    return EvaluationResult(
        truth=true,
        estimate=aligned,
        alignment=alignment,
        association=association,
        transform=transform,
        expected=max(len(true), _expected(truth, estimate, association))
        if expected is None
        else max(expected, 1),
        values=values,
        statistics={metric: Statistics.of(v) for metric, v in values.items()},
        segments=segment_errors(true, aligned),
        roll_from_attitudes=roll_open,
    )


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
    """Least share of the expected poses, 0–1; initialisation counts as missing."""
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
