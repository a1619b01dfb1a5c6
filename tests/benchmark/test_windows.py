"""Windows of a drive in which errors grow, by paths whose errors are known in closed form."""

from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.readings.scores import score
from shared_fixtures.readings.slam_dataset import describe, list_dataset, rig

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.transforms import quat_to_matrix, rpy_to_quat
from recorder.benchmark.plan import Job, find_sequences
from recorder.benchmark.run import BenchmarkResult
from recorder.benchmark.score import ERRORS
from recorder.benchmark.tables import markdown
from recorder.benchmark.windows import hurt_windows, window_errors, window_tables
from recorder.evaluation.align import umeyama
from recorder.evaluation.path_errors import PathErrors
from recorder.slam.systems import SYSTEMS
from recorder.writers.base import DEFAULT_EPOCH_NS

BEGIN_S, STOP_S, GO_S, END_S = 5.0, 16.0, 24.0, 40.0
"""A stretch of a drive along a circle, with a wait at a light."""
WINDOW_S, DRIFT_M, SIGMA_M = 8.0, 1.4, 0.01
TIME_S = np.arange(BEGIN_S, END_S + 0.001, 0.05)


def errors_of(estimate_m: Array, truth_m: Array) -> PathErrors:
    stamp_ns = np.rint(TIME_S * 1e9).astype(np.int64) + DEFAULT_EPOCH_NS
    error_m = np.linalg.norm(estimate_m - truth_m, axis=1)
    return PathErrors(name="e", stamp_ns=stamp_ns, truth_m=truth_m, estimate_m=estimate_m, error_m=error_m)


def truth() -> Array:
    driven_s = TIME_S - np.clip(TIME_S, STOP_S, GO_S)
    angle = driven_s / 8.0
    return np.stack([80 * np.cos(angle), 80 * np.sin(angle), 0 * angle], axis=1)


def estimate(seed: int, drift_m: float) -> Array:
    """The truth with noise in another world; while the car waits, the estimate drifts evenly."""
    share = (np.clip(TIME_S, STOP_S, GO_S) - STOP_S) / (GO_S - STOP_S)
    moved = truth() + np.random.default_rng(seed).normal(0.0, SIGMA_M, (len(TIME_S), 3))
    moved[:, 1] += drift_m * share
    return moved @ quat_to_matrix(rpy_to_quat(0.1, -0.2, 2.0)).T + [10.0, 20.0, 1.0]


def result_of(root: Path, drifts_m: dict[str, float], seeds: int = 1) -> BenchmarkResult:
    """A benchmark of one system over conditions, with a dataset for each seed of noise."""
    for seed in range(seeds):
        for condition in drifts_m:
            folder = root / f"seed{seed}" / "T" / condition
            folder.mkdir(parents=True)
            describe(folder, rig(), samples={})
        list_dataset(root / f"seed{seed}", rig())
    jobs = [
        Job(sequence=one, method="kiss_icp", system=SYSTEMS["kiss_icp"], cloud="raw", run=1)
        for one in find_sequences(root)
    ]
    for k, job in enumerate(jobs):
        (root / "out" / job.folder).mkdir(parents=True)
        path_m = estimate(k, drifts_m[job.sequence.path.name])
        errors_of(path_m, truth()).save(root / "out" / job.folder / ERRORS)
    sequences = [job.sequence for job in jobs]
    scores = [
        score("KISS-ICP", one.traffic, 1.0, dataset=one.dataset, weather=one.weather, coverage=1.0)
        for one in sequences
    ]
    return BenchmarkResult(sequences=sequences, jobs=jobs, scores=scores, reused=0, out=root / "out")


def test_errors_of_windows_are_those_after_a_fit_of_each() -> None:
    x, y = estimate(0, DRIFT_M), truth()
    start_s, error_m = window_errors(errors_of(x, y), DEFAULT_EPOCH_NS, WINDOW_S)
    assert start_s.tolist() == pytest.approx(np.arange(BEGIN_S, END_S - WINDOW_S + 0.01, 0.5).tolist())
    for begin_s, found_m in zip(start_s, error_m, strict=True):
        if begin_s == STOP_S:
            continue  # no rotation is determined where the truth is a point; the next test has its error
        samples = np.flatnonzero(np.abs(TIME_S - begin_s - 0.5 * WINDOW_S) < 0.5 * WINDOW_S + 0.01)[::2]
        fit = umeyama(x[samples], y[samples])
        rest_m = x[samples] @ fit.R.T + fit.t - y[samples]
        assert found_m == pytest.approx(np.sqrt(np.mean(np.sum(rest_m**2, axis=1))), rel=1e-6)


def test_the_window_of_a_wait_among_movers_is_found(tmp_path: Path) -> None:
    """An even drift D of an estimate of a standing car leaves D / √12 behind the best shift."""
    result = result_of(tmp_path, {"ClearNoon_static": 0.0, "ClearNoon_dynamic": DRIFT_M}, seeds=2)
    windows = hurt_windows(result, WINDOW_S)
    (found,) = windows.to_dict("records")
    assert (found["drive"], found["town"]) == ("", "T")
    assert (found["traffic"], found["traffic_base"]) == ("dynamic", "static")
    assert found["start_s"] == pytest.approx(STOP_S, abs=0.5)
    assert found["error_m"] == pytest.approx(DRIFT_M / np.sqrt(12), rel=0.03)
    assert found["error_base_m"] == pytest.approx(SIGMA_M * np.sqrt(3), rel=0.15)
    assert found["ratio"] == pytest.approx(found["error_m"] / found["error_base_m"])
    assert "| KISS-ICP | T | ClearNoon dynamic | 16 | 0.4" in markdown(window_tables(windows))


def test_windows_of_several_pairs_are_sorted_and_gains_left_out(tmp_path: Path) -> None:
    drifts_m = {"ClearNoon_static": 0.3, "FoggyNoon_static": 2.0, "ClearNoon_dynamic": DRIFT_M}
    windows = hurt_windows(result_of(tmp_path, drifts_m | {"FoggyNoon_dynamic": 0.2}), WINDOW_S)
    assert windows[["weather", "traffic", "weather_base", "traffic_base"]].to_numpy().tolist() == [
        ["FoggyNoon", "static", "ClearNoon", "static"],
        ["ClearNoon", "dynamic", "ClearNoon", "static"],
    ]
    assert windows["start_s"].tolist() == pytest.approx([STOP_S] * 2, abs=0.5)


def test_a_drive_shorter_than_a_window_has_none(tmp_path: Path) -> None:
    result = result_of(tmp_path, {"ClearNoon_static": 0.0, "ClearNoon_dynamic": DRIFT_M})
    assert list(window_tables(hurt_windows(result, 60.0))) == []
