"""Rule by which an estimate counts as failed; the paper prints "fail" without one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from recorder.evaluation.evaluation_result import EvaluationResult
from recorder.evaluation.metrics import Metric


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
