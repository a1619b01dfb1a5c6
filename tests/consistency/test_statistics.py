"""NEES, coverage and factors of a Kalman filter whose consistency is known by theory."""

import numpy as np
import pytest
from scipy.stats import binomtest

from carlaloc_env.core.array_types import Array
from recorder.evaluation.confidence import wilson
from recorder.laboratory.pose_statistics import anees_bounds, consistency_of

F, Q = np.array([[1.0, 0.1], [0.0, 1.0]]), np.diag([1e-4, 1e-2])
H, R = np.array([[1.0, 0.0]]), np.array([[0.04]])
P0 = np.diag([1.0, 1.0])


def kalman_runs(runs: int, steps: int, seed: int) -> tuple[Array, Array]:
    """Errors (runs, steps, 2) and covariances of a filter whose model is that of the process."""
    random = np.random.default_rng(seed)
    x = random.multivariate_normal([0.0, 0.0], P0, runs)
    estimate, P, errors, covariances = np.zeros((runs, 2)), P0, [], []
    for _ in range(steps):
        x = x @ F.T + random.multivariate_normal([0.0, 0.0], Q, runs)
        estimate, P = estimate @ F.T, F @ P @ F.T + Q
        S = H @ P @ H.T + R
        K = P @ H.T @ np.linalg.inv(S)
        innovation = x @ H.T + 0.2 * random.normal(size=(runs, 1)) - estimate @ H.T
        estimate, P = estimate + innovation @ K.T, (np.eye(2) - K @ H) @ P
        errors.append(estimate - x)
        covariances.append(P)
    return np.stack(errors, axis=1), np.broadcast_to(np.stack(covariances), (runs, steps, 2, 2)).copy()


def test_the_mean_nees_of_a_matched_filter_is_within_its_bounds_in_95_percent() -> None:
    """2000 experiments of 20 runs; the last step of each is independent of the others'."""
    errors, covariances = kalman_runs(40_000, 30, seed=1)
    last = errors[:, -1].reshape(2000, 20, 2).swapaxes(0, 1), covariances[:, -1].reshape(2000, 20, 2, 2)
    found = consistency_of(last[0], last[1].swapaxes(0, 1))
    assert binomtest(round(2000 * found.within), 2000, 0.95).pvalue > 0.01
    assert found.scale.value == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_a_covariance_times_a_factor_is_found_wrong_by_it(factor: float) -> None:
    errors, covariances = kalman_runs(200, 50, seed=2)
    found = consistency_of(errors, factor * covariances)
    assert found.scale.low < 1.0 / factor < found.scale.high
    assert found.noise_scale.low < 1.0 / factor < found.noise_scale.high
    assert found.axis_scale == pytest.approx(np.full(2, 1.0 / factor), rel=0.1)
    assert (found.within > 0.9) == (factor == 1.0)


def test_coverage_is_that_of_the_ellipsoids_and_an_error_of_all_runs_is_no_scatter() -> None:
    errors, covariances = kalman_runs(2000, 5, seed=3)
    covered = consistency_of(errors, covariances).coverage
    for level, interval in covered.items():
        assert interval.low < level < interval.high
    # χ² with two degrees of freedom has the closed form P(x) = 1 − exp(−x/2): half the covariance.
    halved = consistency_of(errors, 0.5 * covariances).coverage
    for level, interval in halved.items():
        assert interval.value == pytest.approx(1.0 - np.sqrt(1.0 - level), abs=0.02)
    shifted = consistency_of(errors + np.array([0.3, 0.0]), covariances)
    assert shifted.scale.value > 2.0
    assert shifted.noise_scale.value == pytest.approx(1.0, abs=0.05)


def test_bounds_are_those_of_the_book_and_of_scipy() -> None:
    """Bar-Shalom, Li and Kirubarajan (2001), example 5.4.2-1: 50 runs of dimension 2: [1.5, 2.6]."""
    assert anees_bounds(50, 2) == pytest.approx([1.5, 2.6], abs=0.05)
    for inside, trials in ((0, 20), (7, 20), (20, 20)):
        theirs = binomtest(inside, trials).proportion_ci(method="wilson")
        ours = wilson(inside / trials, trials)
        assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), abs=1e-9)


def test_a_covariance_that_is_none_gives_no_nees() -> None:
    errors, covariances = kalman_runs(4, 3, seed=4)
    covariances[:, 1] = 0.0
    found = consistency_of(errors, covariances)
    assert np.isnan(found.anees).tolist() == [False, True, False]
    assert np.isfinite([found.scale.value, found.within, found.coverage[0.9].value]).all()
