"""`carlaloc evaluate` on files of others: the options, and the lines that name them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared_fixtures.readings.pose_bags import ODOMETRY, PATH, POSES, TF, Messages
from shared_fixtures.readings.pose_tables import WXYZ, P, S, drive, estimated, table

from recorder.cli.main import main
from recorder.evaluation.trajectory_files import write_tum

Capture, Log = pytest.CaptureFixture[str], pytest.LogCaptureFixture


@pytest.fixture
def truth(tmp_path: Path) -> str:
    return str(write_tum(tmp_path / "truth.tum", drive()))


def scores(capfd: Capture, *words: str) -> dict[str, Any]:
    assert main(["evaluate", "--json", "--truth", *words]) == 0
    (result,) = json.loads(capfd.readouterr().out)["results"]
    return dict(result)


def ape(result: dict[str, Any]) -> float:
    return float(result["metrics"]["ape_translation"]["rmse"])


def test_a_sparse_truth(tmp_path: Path, capfd: Capture, caplog: Log) -> None:
    sparse = drive().take(np.arange(0, 400, 10)).shifted(37_000_000)
    files = [str(write_tum(tmp_path / "sparse.tum", sparse)), str(write_tum(tmp_path / "e.tum", drive()))]
    assert main(["evaluate", "--truth", *files]) == 1
    assert "pair them by --interpolate, or by --max-gap 0.037" in capfd.readouterr().err
    near = scores(capfd, *files, "--max-gap", "0.05")
    between = scores(capfd, *files, "--interpolate")
    assert near["matched"] == near["expected"] == 40
    assert between["matched"] == 40
    assert "up to 37 ms apart" in caplog.text
    assert between["association"] == "estimate interpolated at the truth's stamps"


def test_options_of_the_truth_are_its_own(tmp_path: Path, truth: str, capfd: Capture, caplog: Log) -> None:
    path = tmp_path / "w_first.txt"
    path.write_text(table(S, P, WXYZ))
    result = scores(capfd, truth, str(path), "--quaternion", "wxyz")
    turned = scores(capfd, str(path), truth, "--truth-quaternion", "wxyz")
    assert caplog.text == ""
    for one in (result, turned):
        assert one["metrics"]["ape_rotation"]["rmse"] < 3.0


def test_topics_of_one_bag(tmp_path: Path, capfd: Capture) -> None:
    make = Messages(ros2=False)
    stamps = drive().stamp_ns.tolist()
    bag = str(
        make.write(
            tmp_path / "run.bag",
            [
                *(
                    ("/truth", ODOMETRY, at, m)
                    for at, m in zip(stamps, make.poses(ODOMETRY, drive()), strict=True)
                ),
                ("/path", PATH, stamps[-1], make.path(stamps[-1], make.poses(POSES[1], estimated()))),
                *(("/tf", TF, *link) for link in make.links(estimated(), "map", "base_link")),
            ],
        )
    )
    for topic in ("/path", "/tf:map.base_link", "/tf"):
        result = scores(capfd, bag, bag, "--truth-topic", "/truth", "--topic", topic)
        assert result["matched"] == 400
        assert ape(result) == pytest.approx(0.085, abs=0.01)
