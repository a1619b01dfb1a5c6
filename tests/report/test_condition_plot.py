"""The picture of conditions has a row for each system."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from recorder.evaluation.path_errors import PathErrors
from recorder.report.condition_plot import ROW_IN, plot_conditions


def test_the_picture_of_conditions_has_a_row_for_each_system(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="draws with matplotlib")
    t = np.linspace(0.0, 6.0, 200)
    truth = np.column_stack([40 * np.cos(t / 4), 40 * np.sin(t / 4), 0 * t])
    stamp_ns = np.rint(t * 1e9).astype(np.int64)
    swing = 0.1 * np.sin(9 * t)
    errors = PathErrors(
        name="e", stamp_ns=stamp_ns, truth_m=truth, estimate_m=truth + swing[:, None], error_m=np.abs(swing)
    )
    levels = {"static": errors, "dynamic": errors}
    heights = []
    for systems in ({"A": levels}, {"A": levels, "B": levels}):
        path = plot_conditions(systems, tmp_path / "plot.png", [truth], "two ways")
        heights.append(np.asarray(cv2.imread(str(path))).shape[0])
    assert heights[1] - heights[0] == pytest.approx(ROW_IN * 110, abs=2)
