"""Errors of an estimate, and the settings that led to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recorder.evaluation.align import Alignment, Similarity
from recorder.evaluation.associate import Association, CoveredTime
from recorder.evaluation.metrics import Metric, SegmentError, Statistics
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
