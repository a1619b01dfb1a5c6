"""The picture of conditions: a row for each system, refused where there is nothing to compare."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from carlaloc_env.core.errors import EvaluationError, OutputError
from recorder.evaluation.evaluate import EvaluationResult, evaluate
from recorder.evaluation.trajectory import Trajectory
from recorder.report.condition_plot import plot_conditions


def result(error_m: float) -> EvaluationResult:
    """A bend, and an estimate that swings about it."""
    t = np.linspace(0.0, 6.0, 200)
    xyz = np.column_stack([40 * np.cos(t / 4), 40 * np.sin(t / 4), 0 * t])
    quat = np.tile([0.0, 0.0, 0.0, 1.0], (len(t), 1))
    stamp_ns = np.rint(t * 1e9).astype(np.int64)
    truth = Trajectory(stamp_ns=stamp_ns, position_m=xyz, quat_xyzw=quat)
    swung = xyz + error_m * np.column_stack([0 * t, 0 * t, np.sin(9 * t)])
    return evaluate(truth, Trajectory(stamp_ns=stamp_ns, position_m=swung, quat_xyzw=quat, name="e"))


def test_every_system_has_a_row(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="draws with matplotlib")
    levels = {"static": result(0.1), "dynamic": result(0.4)}
    one = plot_conditions({"A": levels}, tmp_path / "one.png")
    two = plot_conditions({"A": levels, "B": levels}, tmp_path / "two.png", lanes_m=[np.zeros((2, 2))])
    sizes = [np.asarray(cv2.imread(str(path))).shape for path in (one, two)]
    assert sizes[1][0] - sizes[0][0] == pytest.approx(3.9 * 110, abs=2)
    with pytest.raises(OutputError, match="exists"):
        plot_conditions({"A": levels}, tmp_path / "one.png")


def test_systems_of_different_conditions_are_refused(tmp_path: Path) -> None:
    good = result(0.1)
    for results in ({}, {"A": {"static": good}, "B": {"dynamic": good}}):
        with pytest.raises(EvaluationError, match="the same conditions"):
            plot_conditions(results, tmp_path / "x.png")
