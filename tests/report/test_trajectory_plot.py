"""The trajectory picture shows what was measured."""

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from carlaloc_env.core.errors import EvaluationError, MissingDependencyError
from recorder.evaluation.align import Alignment
from recorder.evaluation.evaluate import evaluate
from recorder.evaluation.evaluation_result import EvaluationResult
from recorder.evaluation.metrics import Metric
from recorder.evaluation.trajectory import Trajectory
from recorder.report.trajectory_plot import plot_trajectories


def result(offset_m: float, metrics: tuple[Metric, ...] = tuple(Metric)) -> EvaluationResult:
    """A circle and an estimate shifted to the east."""
    angle = np.linspace(0.0, 6.0, 200)
    position = np.stack([40 * np.cos(angle), 40 * np.sin(angle), 0 * angle], axis=1)
    quat = np.tile([0.0, 0.0, 0.0, 1.0], (200, 1))
    stamps = np.arange(200, dtype=np.int64) * 50_000_000
    truth = Trajectory(stamp_ns=stamps, position_m=position, quat_xyzw=quat, name="truth")
    shifted = Trajectory(
        stamp_ns=stamps, position_m=position + np.array([offset_m, 0.0, 0.0]), quat_xyzw=quat, name="estimate"
    )
    return evaluate(truth, shifted, alignment=Alignment.NONE, metrics=metrics)


def test_picture_has_every_line(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    path = plot_trajectories([result(3.0), result(8.0)], tmp_path / "plots/a.png", title="Town03")
    picture = cv2.imread(str(path))
    assert picture is not None
    assert picture.shape[0] > 500
    for b, g, r in ((0xB2, 0x72, 0x00), (0x00, 0x5E, 0xD5), (0, 0, 0)):
        assert np.count_nonzero(np.abs(picture.astype(int) - (b, g, r)).sum(axis=2) < 30) > 300
    assert [p.name for p in path.parent.iterdir()] == ["a.png"]


def test_nothing_to_draw_is_a_named_error(tmp_path: Path) -> None:
    with pytest.raises(EvaluationError, match="no position errors"):
        plot_trajectories([], tmp_path / "a.png")
    with pytest.raises(EvaluationError, match="no position errors"):
        plot_trajectories([result(1.0, (Metric.RPE_PAPER,))], tmp_path / "a.png")


def test_missing_matplotlib_names_the_install_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(MissingDependencyError, match=r'pip install "carlaloc\[report\]"'):
        plot_trajectories([result(1.0)], tmp_path / "a.png")
