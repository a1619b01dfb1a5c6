"""Pairs of poses that belong to the same instant."""

from __future__ import annotations

from enum import Enum

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.errors import EvaluationError
from recorder.evaluation.trajectory import Trajectory

MAX_GAP_NS = 10_000_000
"""Poses further apart in time do not belong together [ns]; evo's default."""


class Association(Enum):
    """How poses are paired."""

    NEAREST = "nearest in time"
    INTERPOLATED = "truth interpolated at the estimate's stamps"


def associate(
    truth: Trajectory,
    estimate: Trajectory,
    method: Association = Association.NEAREST,
    *,
    max_gap_ns: int = MAX_GAP_NS,
) -> tuple[Trajectory, Trajectory]:
    """Truth and estimate with one pose each for every pair.

    Args:
        truth: Where the frame was.
        estimate: Where a system says it was.
        method: How poses are paired.
        max_gap_ns: Longest time between two poses of a pair, or between an estimate and each of the
            two true poses that it is interpolated from [ns].

    Raises:
        EvaluationError: no pair was found.
    """
    if method is Association.NEAREST:
        pair = _nearest(truth, estimate, max_gap_ns)
    else:
        pair = _interpolated(truth, estimate, max_gap_ns)
    if not len(pair[0]):
        raise EvaluationError(
            f"no pose of '{estimate.name}' lies within {max_gap_ns / 1e6:g} ms of one of '{truth.name}' "
            f"({_span(estimate)} and {_span(truth)}); {_next_step(truth, estimate)}"
        )
    return pair


def _nearest(truth: Trajectory, estimate: Trajectory, max_gap_ns: int) -> tuple[Trajectory, Trajectory]:
    # As evo does: every pose of the trajectory with fewer poses looks for its nearest partner.
    truth_is_longer = len(truth) >= len(estimate)
    few, many = (estimate, truth) if truth_is_longer else (truth, estimate)
    partner = _nearest_index(many.stamp_ns, few.stamp_ns)
    gap = np.abs(many.stamp_ns[partner] - few.stamp_ns)
    close = np.flatnonzero(gap <= max_gap_ns)
    # Of several with one partner only the closest is a pair.
    order = close[np.lexsort((gap[close], partner[close]))]
    first = np.append(True, np.diff(partner[order]) > 0)[: len(order)]
    chosen = np.sort(order[first])
    found = (many.take(partner[chosen]), few.take(chosen))
    return found if truth_is_longer else (found[1], found[0])


def _nearest_index(sorted_ns: NDArray[np.int64], wanted_ns: NDArray[np.int64]) -> NDArray[np.intp]:
    right = np.clip(np.searchsorted(sorted_ns, wanted_ns), 0, len(sorted_ns) - 1)
    left = np.maximum(right - 1, 0)
    left_is_nearer = wanted_ns - sorted_ns[left] <= np.abs(sorted_ns[right] - wanted_ns)
    return np.where(left_is_nearer, left, right)


def _interpolated(truth: Trajectory, estimate: Trajectory, max_gap_ns: int) -> tuple[Trajectory, Trajectory]:
    after = np.searchsorted(truth.stamp_ns, estimate.stamp_ns)
    exact = truth.stamp_ns[np.minimum(after, len(truth) - 1)] == estimate.stamp_ns
    before = np.where(exact, after, after - 1)
    inside = (before >= 0) & (after < len(truth))
    before, after = np.clip(before, 0, len(truth) - 1), np.clip(after, 0, len(truth) - 1)
    early = estimate.stamp_ns - truth.stamp_ns[before]
    late = truth.stamp_ns[after] - estimate.stamp_ns
    rows = np.flatnonzero(inside & (early <= max_gap_ns) & (late <= max_gap_ns))
    matched = estimate.take(rows)
    return truth.at(matched.stamp_ns), matched


def _next_step(truth: Trajectory, estimate: Trajectory) -> str:
    if not (len(truth) and len(estimate)):
        return "give trajectories with poses"
    apart_ns = max(truth.stamp_ns[0] - estimate.stamp_ns[-1], estimate.stamp_ns[0] - truth.stamp_ns[-1])
    if apart_ns <= 0:
        return "check the stamps"
    return f"the stamps lie {apart_ns / 1e9:.6g} s apart; use --time-offset search"


def _span(trajectory: Trajectory) -> str:
    if not len(trajectory):
        return "no poses"
    return f"{trajectory.stamp_ns[0] / 1e9:.3f}…{trajectory.stamp_ns[-1] / 1e9:.3f} s"
