"""Pairs poses of two trajectories that belong to the same instant."""

import logging
import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.errors import EvaluationError
from recorder.evaluation.stamp_units import has_frame_numbers
from recorder.evaluation.trajectory import Trajectory

_LOG = logging.getLogger(__name__)
MAX_GAP_NS = 10_000_000
"""Poses further apart in time do not belong together [ns]; evo's default."""
_USUAL_STEPS = 5.0
"""Time between pairs is covered up to so many of their median intervals."""
_CLOCKS_S = {
    18: "the leap seconds between GPS time and UTC",
    37: "the leap seconds between TAI and UTC",
}
"""Constant differences of clocks since 2017 [s]."""


class Association(Enum):
    """Methods of pairing poses."""

    NEAREST = "nearest in time"
    INTERPOLATED = "truth interpolated at the estimate's stamps"
    ESTIMATE_INTERPOLATED = "estimate interpolated at the truth's stamps"


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
        estimate: A system's poses.
        method: How poses are paired.
        max_gap_ns: Longest time between two poses of a pair, or between a pose and each of the two that its
            partner is interpolated from [ns].

    Raises:
        EvaluationError: no pair was found.
    """
    if method is Association.NEAREST:
        pair = _nearest(truth, estimate, max_gap_ns)
    elif method is Association.INTERPOLATED:
        pair = _interpolated(truth, estimate, max_gap_ns)
    else:
        between, matched = _interpolated(estimate, truth, max_gap_ns)
        pair = matched, between
    if not len(pair[0]):
        raise EvaluationError(
            f"no pose of '{estimate.name}' lies within {max_gap_ns / 1e6:g} ms of one of '{truth.name}' "
            f"({_span(estimate)} and {_span(truth)}); {_next_step(truth, estimate, max_gap_ns)}"
        )
    if method is Association.NEAREST:
        _warn_of_gaps(truth, estimate, pair, max_gap_ns)
    return pair


def _warn_of_gaps(
    truth: Trajectory, estimate: Trajectory, pair: tuple[Trajectory, Trajectory], max_gap_ns: int
) -> None:
    names = f"'{estimate.name}' and '{truth.name}'"
    widest_ns = int(np.abs(pair[0].stamp_ns - pair[1].stamp_ns).max())
    if widest_ns > MAX_GAP_NS:
        _LOG.warning(
            "%s: poses of a pair lie up to %g ms apart; the motion meanwhile counts as error, less with "
            "--interpolate", names, widest_ns / 1e6,
        )  # fmt: skip
    count, apart_ns = _beyond_gap(truth, estimate, max_gap_ns) or (0, 0)
    if count > len(pair[0]):
        _LOG.warning(
            "%s: %d pairs within %g ms, but %d poses without a partner; %s",
            names, len(pair[0]), max_gap_ns / 1e6, count, _wider(apart_ns),
        )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class CoveredTime:
    """Part of the time from the first to the last pose of two trajectories that has pairs."""

    share: float
    """That part, 0–1."""
    longest_gap_s: float
    """Longest time without a pair [s]."""
    gap_after_ns: int
    """Where that begins [ns]."""

    @staticmethod
    def of(truth: Trajectory, estimate: Trajectory, pair_ns: NDArray[np.int64]) -> "CoveredTime":
        """The time that pairs cover, by their stamps [ns], of which there are two at least."""
        both = (truth.stamp_ns, estimate.stamp_ns)
        marks = np.array([min(s[0] for s in both), *pair_ns, max(s[-1] for s in both)])
        steps = np.diff(marks)
        covered = steps[steps <= _USUAL_STEPS * np.median(np.diff(pair_ns))].sum()
        k = int(np.argmax(steps))
        share = float(covered / steps.sum())
        return CoveredTime(share=share, longest_gap_s=float(steps[k]) * 1e-9, gap_after_ns=int(marks[k]))

    def __str__(self) -> str:
        gap = f"none for {self.longest_gap_s:.1f} s after {self.gap_after_ns / 1e9:.3f} s"
        return f"{self.share:.0%} of the time: {gap}"


def interpolation(truth: Trajectory, estimate: Trajectory) -> tuple[Association, int]:
    """Interpolation of the trajectory of the higher rate, and the widest gap over which it goes [ns]."""
    intervals = [
        int(np.median(np.diff(trajectory.stamp_ns))) if len(trajectory) > 1 else 0
        for trajectory in (truth, estimate)
    ]
    # Of equal rates the truth's, which is smooth.
    of_truth = intervals[0] <= 1.1 * intervals[1]
    gap_ns = max(MAX_GAP_NS, intervals[0 if of_truth else 1] * 3 // 2)
    return (Association.INTERPOLATED if of_truth else Association.ESTIMATE_INTERPOLATED), gap_ns


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
    pair = (many.take(partner[chosen]), few.take(chosen))
    return pair if truth_is_longer else (pair[1], pair[0])


def _nearest_index(sorted_ns: NDArray[np.int64], wanted_ns: NDArray[np.int64]) -> NDArray[np.intp]:
    right = np.clip(np.searchsorted(sorted_ns, wanted_ns), 0, len(sorted_ns) - 1)
    left = np.maximum(right - 1, 0)
    left_is_nearer = wanted_ns - sorted_ns[left] <= np.abs(sorted_ns[right] - wanted_ns)
    return np.where(left_is_nearer, left, right)


def _interpolated(dense: Trajectory, other: Trajectory, max_gap_ns: int) -> tuple[Trajectory, Trajectory]:
    after = np.searchsorted(dense.stamp_ns, other.stamp_ns)
    exact = dense.stamp_ns[np.minimum(after, len(dense) - 1)] == other.stamp_ns
    before = np.where(exact, after, after - 1)
    inside = (before >= 0) & (after < len(dense))
    before, after = np.clip(before, 0, len(dense) - 1), np.clip(after, 0, len(dense) - 1)
    early = other.stamp_ns - dense.stamp_ns[before]
    late = dense.stamp_ns[after] - other.stamp_ns
    rows = np.flatnonzero(inside & (early <= max_gap_ns) & (late <= max_gap_ns))
    matched = other.take(rows)
    return dense.at(matched.stamp_ns), matched


def _beyond_gap(truth: Trajectory, estimate: Trajectory, max_gap_ns: int) -> tuple[int, int] | None:
    """Poses of the shorter trajectory, within the time of the other, that have no near partner.

    Returns:
        Their number, and the longest time to a partner [ns]; None: there is none.
    """
    few, many = (estimate, truth) if len(truth) >= len(estimate) else (truth, estimate)
    wanted = few.stamp_ns[(few.stamp_ns >= many.stamp_ns[0]) & (few.stamp_ns <= many.stamp_ns[-1])]
    gap = np.abs(many.stamp_ns[_nearest_index(many.stamp_ns, wanted)] - wanted)
    far = gap[gap > max_gap_ns]
    return (len(far), int(far.max())) if len(far) else None


def _next_step(truth: Trajectory, estimate: Trajectory, max_gap_ns: int) -> str:
    if not (len(truth) and len(estimate)):
        return "give trajectories with poses"
    for one in (estimate, truth):
        if has_frame_numbers(one.stamp_ns):
            return f"the times of '{one.name}' are numbers of frames; give --times with a time for each frame"
    apart_ns = max(truth.stamp_ns[0] - estimate.stamp_ns[-1], estimate.stamp_ns[0] - truth.stamp_ns[-1])
    if apart_ns > 0:
        starts_s = float(truth.stamp_ns[0] - estimate.stamp_ns[0]) * 1e-9
        name = clock_name(starts_s, within_s=0.5 * truth.duration_s + 1.0)
        return f"the stamps lie {apart_ns / 1e9:.6g} s apart{name}; use --time-offset search"
    missing = _beyond_gap(truth, estimate, max_gap_ns)
    return _wider(missing[1]) if missing else "check the stamps"


def clock_name(offset_s: float, *, within_s: float = 0.3) -> str:
    """Name in brackets of a difference of clocks that fits an offset within a tolerance [s]; else empty."""
    hours = round(offset_s / 3600.0)
    if 1 <= abs(hours) <= 14 and abs(offset_s - 3600.0 * hours) < min(within_s, 900.0):
        return f" ({abs(hours)} h: whole hours, as between time zones)"
    for known_s, name in _CLOCKS_S.items():
        if abs(abs(offset_s) - known_s) < min(within_s, 0.3):
            return f" ({name})"
    return ""


def _wider(apart_ns: int) -> str:
    """The options that pair poses up to some time apart [ns]."""
    return f"pair them by --interpolate, or by --max-gap {_rounded_up_s(apart_ns):g}"


def _rounded_up_s(value_ns: int) -> float:
    """The time in seconds, two digits, not below it."""
    unit = 10.0 ** (math.floor(math.log10(max(value_ns, 1))) - 1)
    return float(f"{math.ceil(value_ns / unit) * unit * 1e-9:.3g}")


def _span(trajectory: Trajectory) -> str:
    if not len(trajectory):
        return "no poses"
    return f"{trajectory.stamp_ns[0] / 1e9:.3f}…{trajectory.stamp_ns[-1] / 1e9:.3f} s"
