"""Finds the time offset between the clocks of two trajectories by their motions."""

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import correlate

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from recorder.evaluation.align import Alignment, align, position_error_m
from recorder.evaluation.associate import Association, associate
from recorder.evaluation.stamp_units import has_frame_numbers
from recorder.evaluation.trajectory import Trajectory

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
    """Find the offset to add to an estimate's stamps [ns].

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
    lag, agreement = max(
        (_correlated(_rates(truth, step_s, kind), _rates(estimate, step_s, kind)) for kind in ("turn", "go")),
        key=lambda result: result[1],
    )
    if not agreement > _AGREEMENT_MIN:
        cure = (
            "--times with a time for each frame"
            if has_frame_numbers(estimate.stamp_ns)
            else "the offset itself"
        )
        raise EvaluationError(
            f"the motions of '{estimate.name}' and '{truth.name}' do not resemble each other at any offset "
            f"(correlation {agreement:.2f}); give {cure}"
        )
    coarse_ns = int(truth.stamp_ns[0] - estimate.stamp_ns[0]) + round(lag * step_s * 1e9)
    best = minimize_scalar(
        lambda offset_ns: error_at(truth, estimate, coarse_ns + round(offset_ns), alignment)[0],
        bounds=(-_REACH_NS, _REACH_NS),
        method="bounded",
        options={"xatol": 1e4},
    )
    return coarse_ns + round(float(best.x))


def error_at(
    truth: Trajectory, estimate: Trajectory, offset_ns: int, alignment: Alignment
) -> tuple[float, int]:
    """Position error of an estimate with an offset added to its stamps, RMSE [m], and the number of pairs."""
    gap_ns = 2 * int(np.median(np.diff(truth.stamp_ns)))
    shifted = estimate.shifted(offset_ns)
    true, paired = associate(truth, shifted, Association.INTERPOLATED, max_gap_ns=gap_ns)
    return position_error_m(true, align(true, paired, alignment).apply(paired)), len(true)


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
