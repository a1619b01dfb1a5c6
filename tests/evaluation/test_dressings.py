"""One estimate as the tables of many systems and data sets would hold it: the same scores each time."""

from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.readings.pose_tables import DRESSINGS, EPOCH_NS, S, drive, estimated

from recorder.evaluation import text_tables
from recorder.evaluation.evaluate import evaluate
from recorder.evaluation.metrics import Metric
from recorder.evaluation.trajectory_files import read_text_trajectory, write_tum


@pytest.mark.parametrize("is_long", [False, True])
@pytest.mark.parametrize("name", DRESSINGS)
def test_every_dressing_scores_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, is_long: bool
) -> None:
    """Long files are read by Arrow where it can."""
    if is_long:
        monkeypatch.setattr(text_tables, "_LONG_BYTES", 0)
    file, text = DRESSINGS[name]
    (tmp_path / file).write_text(text, encoding="utf-8", newline="")
    (tmp_path / "times.txt").write_text("\n".join(S))
    read = read_text_trajectory(tmp_path / file)
    if "since the start" in name:
        read = read.shifted(EPOCH_NS)
    assert read.stamp_ns.tolist() == drive().stamp_ns.tolist()
    plain, dressed = evaluate(drive(), estimated()), evaluate(drive(), read)
    for metric in Metric:
        tolerance = 1e-9 if metric.unit == "m" else 1e-6
        assert np.abs(plain.values[metric] - dressed.values[metric]).max() < tolerance, metric
    assert plain.statistics[Metric.APE_TRANSLATION].rmse == pytest.approx(0.085, abs=0.01)


def test_the_plain_scores_are_evo_s(tmp_path: Path) -> None:
    interface = pytest.importorskip("evo.tools.file_interface")
    metrics = pytest.importorskip("evo.core.metrics")
    truth, estimate = (
        interface.read_tum_trajectory_file(str(write_tum(tmp_path / f"{one.name}.tum", one)))
        for one in (drive(), estimated())
    )
    estimate.align(truth)
    ours = evaluate(drive(), estimated())
    for metric, relation in (
        (Metric.APE_TRANSLATION, metrics.PoseRelation.translation_part),
        (Metric.APE_ROTATION, metrics.PoseRelation.rotation_angle_deg),
    ):
        theirs = metrics.APE(relation)
        theirs.process_data((truth, estimate))
        assert ours.statistics[metric].rmse == pytest.approx(theirs.get_all_statistics()["rmse"], abs=1e-9)
