"""Pairs of poses that belong to the same instant.

The time offset between two clocks, found by how the motion looks in both.
"""

import logging
import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.signal import correlate

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from recorder.evaluation.align import Alignment, align, position_error_m
from recorder.evaluation.trajectory import Trajectory

MAX_GAP_NS = 10_000_000
"""Poses further apart in time do not belong together [ns]; evo's default."""
_LOG = logging.getLogger(__name__)


class Association(Enum):
    """How poses are paired."""

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


_USUAL_STEPS = 5.0
"""Time between pairs is covered up to so many of their median intervals."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CoveredTime:
    """How much of the time from the first to the last pose of two trajectories has pairs."""

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
    """Which of two trajectories to interpolate, the one of the higher rate, and over what gaps [ns]."""
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
    found = (many.take(partner[chosen]), few.take(chosen))
    return found if truth_is_longer else (found[1], found[0])


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
    apart_ns = max(truth.stamp_ns[0] - estimate.stamp_ns[-1], estimate.stamp_ns[0] - truth.stamp_ns[-1])
    if apart_ns > 0:
        starts_s = float(truth.stamp_ns[0] - estimate.stamp_ns[0]) * 1e-9
        name = clock_name(starts_s, within_s=0.5 * truth.duration_s + 1.0)
        return f"the stamps lie {apart_ns / 1e9:.6g} s apart{name}; use --time-offset search"
    missing = _beyond_gap(truth, estimate, max_gap_ns)
    return _wider(missing[1]) if missing else "check the stamps"


_CLOCKS_S = {
    18: "the leap seconds between GPS time and UTC",
    37: "the leap seconds between TAI and UTC",
}
"""Constant differences of clocks since 2017 [s]."""


def clock_name(offset_s: float, *, within_s: float = 0.3) -> str:
    """In brackets, the known difference of clocks that an offset is, up to a tolerance [s]; else empty."""
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


_GRID_S = 0.01
"""Step of the first search [s]."""
_SAMPLES_MAX = 400_000
"""Longest signal of the first search: more than an hour."""
_BASE_S = 0.5
"""Time over which rates are taken, where there are enough poses [s]."""
_REACH_NS = 300_000_000
"""Reach of the second search about the result of the first, which noise displaces [ns]."""
_AGREEMENT_MIN = 0.5
"""Least correlation of the two motions at the best offset."""


def find_time_offset(truth: Trajectory, estimate: Trajectory, alignment: Alignment = Alignment.SE3) -> int:
    """What has to be added to an estimate's stamps [ns].

    First the rates of turning, which neither the world's axes nor a lever arm change, are laid over each
    other by cross-correlation, whatever the clocks' zeros; the speeds where nothing turns. Then the
    offset with the least position error is looked for around that.

    Args:
        truth: Where the frame was.
        estimate: A system's poses, by another clock.
        alignment: Fit before errors are measured.

    Raises:
        EvaluationError: the motions do not resemble each other.
    """
    if min(len(truth), len(estimate)) < 10:
        raise EvaluationError(
            f"'{estimate.name}' or the truth has less than 10 poses; give the offset itself"
        )
    step_s = max(_GRID_S, max(truth.duration_s, estimate.duration_s) / _SAMPLES_MAX)
    found = max(
        (_correlated(_rates(truth, step_s, kind), _rates(estimate, step_s, kind)) for kind in ("turn", "go")),
        key=lambda result: result[1],
    )
    lag, agreement = found
    if not agreement > _AGREEMENT_MIN:
        raise EvaluationError(
            f"the motions of '{estimate.name}' and '{truth.name}' do not resemble each other at any offset "
            f"(correlation {agreement:.2f}); give the offset itself"
        )
    coarse_ns = int(truth.stamp_ns[0] - estimate.stamp_ns[0]) + round(lag * step_s * 1e9)
    return _refined(truth, estimate, coarse_ns, _REACH_NS, alignment)


def _rates(trajectory: Trajectory, step_s: float, kind: str) -> Array:
    """Rate of turning [rad/s] or speed [m/s] on a regular grid from the first pose on."""
    t = (trajectory.stamp_ns - trajectory.stamp_ns[0]) * 1e-9
    # Between neighbours, noise of poses hides the motion.
    k = max(1, min(round(_BASE_S * (len(t) - 1) / t[-1]), len(t) // 20))
    grid = np.arange(0.0, t[-1], step_s)
    if kind == "go":
        moved = np.linalg.norm(trajectory.position_m[k:] - trajectory.position_m[:-k], axis=1)
    else:
        turn = transforms.quat_multiply(
            transforms.quat_conjugate(trajectory.quat_xyzw[:-k]), trajectory.quat_xyzw[k:]
        )
        moved = 2.0 * np.arctan2(np.linalg.norm(turn[:, :3], axis=1), np.abs(turn[:, 3]))
    rate: Array = np.interp(grid, 0.5 * (t[k:] + t[:-k]), moved / (t[k:] - t[:-k]))
    return rate


def _correlated(first: Array, second: Array) -> tuple[int, float]:
    """Shift of the second signal with the highest correlation, and that correlation, 0–1."""
    first, second = first - first.mean(), second - second.mean()
    scale = float(np.linalg.norm(first) * np.linalg.norm(second))
    if scale < 1e-6 * len(first):
        return 0, 0.0
    product = correlate(first, second, mode="full", method="fft")
    best = int(np.argmax(product))
    lag = best - (len(second) - 1)
    a, b = max(lag, 0), min(len(first), lag + len(second))
    one, other = first[a:b], second[a - lag : b - lag]
    norm = float(np.linalg.norm(one) * np.linalg.norm(other))
    return lag, float(one @ other) / norm if norm > 0 else 0.0


def _refined(
    truth: Trajectory, estimate: Trajectory, coarse_ns: int, reach_ns: int, alignment: Alignment
) -> int:
    gap_ns = 2 * int(np.median(np.diff(truth.stamp_ns)))

    def error_m(offset_ns: float) -> float:
        shifted = estimate.shifted(coarse_ns + round(offset_ns))
        true, paired = associate(truth, shifted, Association.INTERPOLATED, max_gap_ns=gap_ns)
        return position_error_m(true, align(true, paired, alignment).apply(paired))

    best = minimize_scalar(error_m, bounds=(-reach_ns, reach_ns), method="bounded", options={"xatol": 1e4})
    return coarse_ns + round(float(best.x))
