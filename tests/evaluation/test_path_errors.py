"""Errors along a path: when an estimate begins to leave the truth."""

import numpy as np
import pytest

from recorder.evaluation.path_errors import PathErrors


@pytest.mark.parametrize("shift_m", [0.0, 5.0])
def test_an_estimate_leaves_where_it_drifts_fastest(shift_m: float) -> None:
    """It drifts by 0.1 m/s, and by 2 m/s from 4 s to 6 s; a fit that shifts all of it changes nothing."""
    t = np.linspace(0.0, 10.0, 201)
    truth_m = np.column_stack([8.0 * t, 0.0 * t, 0.0 * t])
    drift_m = 0.1 * t + 2.0 * np.clip(t - 4.0, 0.0, 2.0) + shift_m
    estimate_m = truth_m + drift_m[:, None] * [0.0, 1.0, 0.0]
    stamp_ns = np.rint(t * 1e9).astype(np.int64)
    errors = PathErrors(
        name="e", stamp_ns=stamp_ns, truth_m=truth_m, estimate_m=estimate_m, error_m=np.abs(drift_m)
    )
    # Over the second from 3.5 s on it moves away by 1.1 of at most 2.1 m.
    assert errors.leaves_truth_at_ns() == pytest.approx(3.5e9, abs=0.051e9)
