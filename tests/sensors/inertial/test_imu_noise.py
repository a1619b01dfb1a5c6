"""Noise of the IMU: densities, bias walks and bias instability against theory."""

from typing import Any

import numpy as np
import pytest
from scipy.fft import dst
from scipy.optimize import nnls
from shared_fixtures.readings.imu_readings import QUIET, read

from carlaloc_env.core.array_types import Array
from carlaloc_env.sensors.imu import ImuConfig
from carlaloc_env.sensors.stochastic_processes import Flicker, GaussMarkov, RandomWalk


def allan_variance(x: Array, strides: list[int]) -> Array:
    """Overlapping Allan variance of readings at 200 Hz."""
    total = np.concatenate([[0.0], np.cumsum(x)])
    means = [(total[m:] - total[:-m]) / m for m in strides]
    return np.array([0.5 * np.mean((a[m:] - a[:-m]) ** 2) for a, m in zip(means, strides, strict=True)])


def imu_noise(scenery: Any, count: int) -> Array:
    """White noise and bias walk of the paper's IMU, shape (count, 6)."""
    imu = ImuConfig().build(scenery.world())
    spans = [np.arange(k, k + 10_000, dtype=np.int64) for k in range(0, count, 10_000)]
    white = np.concatenate([imu._white.rows(span) for span in spans])
    walk = np.concatenate([imu._walk.rows(span) for span in spans])
    noise: Array = imu._white_scale * white + imu._walk_scale * walk
    return noise


def test_noise_densities_by_allan_variance(scenery: Any) -> None:
    """A joint fit σ²(τ) = N²/τ + K²·τ/3 over 1200 s returns the configured densities, not per-sample numbers.

    N and the accelerometer's K hold on each axis. The gyroscope's K holds as the rms of the axes only:
    of 1200 s no unbiased estimator knows one axis's better than to 13 % (1σ), see `walk_bound`.
    """
    strides = [2, 5, 10, 30, 100, 300, 1000, 3000, 10000]
    tau = np.array(strides) / 200
    noise = imu_noise(scenery, 200 * 1200)
    found = []
    for axis in range(6):
        variance = allan_variance(noise[:, axis], strides)
        A = np.stack([1 / tau, tau / 3], axis=-1) / variance[:, None]
        squares, _ = nnls(A / np.sqrt(tau)[:, None], 1 / np.sqrt(tau))
        found.append(np.sqrt(squares))
    n, k = np.array(found).T
    assert n[:3] == pytest.approx(2e-3, rel=0.03)
    assert n[3:] == pytest.approx(2e-4, rel=0.03)
    assert k[:3] == pytest.approx(3e-3, rel=0.15)
    assert np.sqrt(np.mean(k[3:] ** 2)) == pytest.approx(2e-5, rel=0.15)


def difference_spectrum(count: int) -> Array:
    """Power of the differences of unit white noise along the eigenvectors of their covariance.

    That of a random walk's differences is 1 along each: white noise and walk together are
    independent normal numbers of variance N²/Δt·c + K²·Δt there, exactly.
    """
    return 2.0 - 2.0 * np.cos(np.pi * np.arange(1, count) / count)


def walk_bound(density: float, walk: float, seconds: float) -> float:
    """Cramér–Rao bound of the walk K, relative, N being unknown too; close to √(2N / (K·T))."""
    a, b, c = density**2 * 200, walk**2 / 200, difference_spectrum(round(200 * seconds))
    rows = np.stack([c, np.ones_like(c)]) / (a * c + b)
    return float(0.5 * np.sqrt(np.linalg.inv(0.5 * rows @ rows.T)[1, 1]) / b)


def most_likely(x: Array) -> tuple[float, float]:
    """Maximum-likelihood N and K of readings at 200 Hz, by Fisher scoring."""
    power, c = dst(np.diff(x), type=1, norm="ortho") ** 2, difference_spectrum(len(x))
    a, b = float(np.mean(power) / np.mean(c)), 1e-6 * float(np.mean(power))
    before = np.inf
    while abs(b - before) > 1e-6 * b:
        before, rows = b, np.stack([c, np.ones_like(c)]) / (a * c + b)
        a, b = np.linalg.solve(rows @ rows.T, rows @ (power / (a * c + b)))
        b = max(b, 0.2 * before)
    return float(np.sqrt(a / 200)), float(np.sqrt(b * 200))


def test_walk_of_each_gyro_axis_in_a_log_long_enough(scenery: Any) -> None:
    """At 1200 s the bound of K is 3.3 % and 13 %; at 8000 s the gyroscope's is 5 %, and 15 % are 3σ."""
    assert walk_bound(2e-3, 3e-3, 1200.0) == pytest.approx(0.033, abs=5e-4)
    assert walk_bound(2e-4, 2e-5, 1200.0) == pytest.approx(0.130, abs=5e-4)
    assert walk_bound(2e-4, 2e-5, 8000.0) == pytest.approx(0.050, abs=5e-4)
    found = np.array([most_likely(x) for x in imu_noise(scenery, 200 * 8000)[:, 3:].T])
    assert found[:, 0] == pytest.approx(2e-4, rel=0.005)
    assert found[:, 1] == pytest.approx(2e-5, rel=0.15)


def test_no_estimator_beats_the_bound_and_the_likeliest_reaches_it() -> None:
    """K over 30 logs of 1200 s of numpy's own noise: no bias, and the spread that the bound says."""
    rng = np.random.default_rng(1)
    for density, walk in ((2e-3, 3e-3), (2e-4, 2e-5)):
        found = []
        for _ in range(30):
            white, steps = rng.standard_normal((2, 200 * 1200))
            x = density * np.sqrt(200) * white + walk / np.sqrt(200) * np.cumsum(steps)
            found.append(most_likely(x)[1] / walk)
        bound = walk_bound(density, walk, 1200.0)
        assert np.mean(found) == pytest.approx(1.0, abs=3 * bound / np.sqrt(30))
        assert np.std(found) == pytest.approx(bound, rel=0.39)  # 3σ of a spread of 30


def test_white_noise_per_sample(scenery: Any) -> None:
    """At 200 Hz the paper's density 2e-3 means 0.0283 m/s² per sample."""
    config = {**QUIET, "accel_noise_density": 2e-3}
    x = read(scenery, scenery.straight(0.0), 30.0, **config)[:, :3] - [0, 0, 9.81]
    assert x.std() == pytest.approx(2e-3 * np.sqrt(200), rel=0.03)
    assert np.abs(np.corrcoef(x.T) - np.eye(3)).max() < 0.06


def test_bias_walks_with_the_square_root_of_time() -> None:
    """Steps of the walk are standard normal; the spread over seeds grows as √n."""
    ends = np.concatenate(
        [RandomWalk(seed, "imu/bias", 6).rows(np.array([400, 1600])) for seed in range(60)], axis=0
    )
    assert ends[0::2].std() == pytest.approx(20, rel=0.12)
    assert ends[1::2].std() == pytest.approx(40, rel=0.12)
    steps = np.diff(RandomWalk(1, "imu/bias", 2).rows(np.arange(5000)), axis=0)
    assert steps.std() == pytest.approx(1.0, rel=0.03)


def test_bias_instability_is_flat_at_its_level() -> None:
    """Allan deviation of the flicker alone: 0.664·B from 10 s to 300 s, over 16 axes of 3000 s at 10 Hz."""
    noise = Flicker(4, "imu/flicker", 16, period_s=0.1).rows(np.arange(30_000, dtype=np.int64))
    for tau in (10.0, 30.0, 100.0, 300.0):
        stride = round(tau * 10)
        variance = np.mean([allan_variance(noise[:, k], [stride])[0] for k in range(16)])
        assert np.sqrt(variance) == pytest.approx(0.664, rel=0.15), tau


def test_gauss_markov_keeps_variance_and_correlation() -> None:
    """Variance 1 from the first sample on, correlation e⁻¹ after one time constant, any order of access."""
    process = GaussMarkov(5, "x", 400, period_s=0.2, time_constant_s=10.0)
    rows = process.rows(np.array([0, 50, 430]))
    assert rows.std(axis=1) == pytest.approx([1.0, 1.0, 1.0], rel=0.1)
    assert np.mean(rows[0] * rows[1]) == pytest.approx(np.exp(-1.0), abs=0.12)
    again = GaussMarkov(5, "x", 400, period_s=0.2, time_constant_s=10.0).rows(np.array([430]))
    assert again.tobytes() == rows[2:].tobytes()
