"""Scoring an hour of 200 Hz poses from two files, beside evo on the same files."""

import tempfile
import time
from pathlib import Path

import numpy as np
from bench import Bench, Row
from timing import time_calls

from recorder.evaluation.evaluate import evaluate
from recorder.evaluation.evaluation_result import EvaluationResult
from recorder.evaluation.metrics import Metric
from recorder.evaluation.trajectory import Trajectory
from recorder.evaluation.trajectory_files import read_tum, write_tum

RATE_HZ = 200
HOUR_S, QUICK_S = 3600, 60
TARGET = 10.0


def evaluation(bench: Bench) -> Row:
    """Both files read, aligned, and their absolute position error; evo does the same once."""
    duration_s = QUICK_S if bench.quick else HOUR_S
    what = f"APE of {duration_s / 60:.0f} min at {RATE_HZ} Hz, both files read, beside evo"
    with tempfile.TemporaryDirectory() as folder:
        truth, estimate = (
            write_tum(Path(folder, name), trajectory)
            for name, trajectory in zip(("t.tum", "e.tum"), _pair(duration_s * RATE_HZ), strict=True)
        )

        def once() -> EvaluationResult:
            return evaluate(read_tum(truth), read_tum(estimate), metrics=(Metric.APE_TRANSLATION,))

        ours = time_calls({"ours": once}, min(bench.repeat, 3))["ours"]
        read = read_tum(truth), read_tum(estimate)
        metric = time_calls({"m": lambda: evaluate(*read, metrics=(Metric.APE_TRANSLATION,))}, 3)["m"]
        theirs = _evo(truth, estimate)
    note = f"the metric alone, poses in memory: {metric.median_s:.2f} s, {metric.cpu_s:.2f} s of CPU time"
    if theirs is None:
        return Row(name="evaluation", what=what, value=None, unit="×", target=TARGET, note="evo is missing")
    difference_m = abs(theirs[1] - once_rmse(read))
    return Row(
        name="evaluation",
        what=what,
        value=theirs[0] / ours.cpu_s,
        unit="× less CPU",
        target=TARGET,
        ours=ours,
        note=f"{note}; evo {theirs[0]:.1f} s of CPU time; RMSE differ by {difference_m:.1e} m",
        detail={"evo_cpu_s": theirs[0], "metric_s": metric.median_s},
    )


def once_rmse(pair: tuple[Trajectory, Trajectory]) -> float:
    """Position error of a pair [m]."""
    return evaluate(*pair, metrics=(Metric.APE_TRANSLATION,)).statistics[Metric.APE_TRANSLATION].rmse


def _pair(count: int) -> tuple[Trajectory, Trajectory]:
    t = np.arange(count) / RATE_HZ
    position = np.stack([100 * np.cos(t / 50), 100 * np.sin(t / 50), 0.1 * np.sin(t)], axis=1)
    half = 0.5 * (t / 50 + np.pi / 2)
    quat = np.stack([0 * t, 0 * t, np.sin(half), np.cos(half)], axis=1)
    stamps = 1_672_531_200_000_000_000 + np.arange(count, dtype=np.int64) * (10**9 // RATE_HZ)
    off = np.random.default_rng(0).normal(0.0, 0.1, position.shape)
    truth = Trajectory(stamp_ns=stamps, position_m=position, quat_xyzw=quat, name="truth")
    return truth, Trajectory(stamp_ns=stamps, position_m=position + off, quat_xyzw=quat, name="estimate")


def _evo(truth: Path, estimate: Path) -> tuple[float, float] | None:
    """CPU time [s] and RMSE [m] of evo; None where it is not installed."""
    try:
        from evo.core import metrics, sync
        from evo.tools import file_interface
    except ImportError:
        return None
    began = time.process_time()
    reference = file_interface.read_tum_trajectory_file(str(truth))
    read = file_interface.read_tum_trajectory_file(str(estimate))
    reference, read = sync.associate_trajectories(reference, read)
    read.align(reference)
    ape = metrics.APE(metrics.PoseRelation.translation_part)
    ape.process_data((reference, read))
    return time.process_time() - began, float(ape.get_statistic(metrics.StatisticsType.rmse))
