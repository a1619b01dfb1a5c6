"""Causes of errors that lie in files and settings: named with their cure, and none where there is none."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared_fixtures.readings.pose_tables import RPY, XYZW, P, S, drive, estimated, table

from carlaloc_env.core import transforms
from carlaloc_env.core.errors import EvaluationError
from recorder.cli.main import main
from recorder.evaluation.align import Alignment
from recorder.evaluation.evaluate import evaluate
from recorder.evaluation.fail_rule import FailRule
from recorder.evaluation.metrics import OF_POSITIONS, Metric
from recorder.evaluation.trajectory import Trajectory
from recorder.evaluation.trajectory_files import read_text_trajectory, write_tum

CAMERA = transforms.rpy_to_quat(*np.radians([-90.0, 0.0, -90.0]))
Capture = pytest.CaptureFixture[str]


def turned(one: Trajectory, quat: np.ndarray) -> Trajectory:
    return replace(one, quat_xyzw=transforms.quat_multiply(one.quat_xyzw, np.tile(quat, (len(one), 1))))


def rmse(result: Any, metric: Metric) -> float:
    return float(result.statistics[metric].rmse)


@pytest.mark.parametrize("alignment", Alignment)
def test_an_estimate_with_noise_alone_has_no_finding(alignment: Alignment) -> None:
    assert evaluate(drive(), estimated(), alignment=alignment).findings == ()


@pytest.mark.parametrize(
    ("rpy_deg", "angle"), [((-90, 0, -90), "120."), ((0, 0, 180), "1"), ((0, 8, 0), "8.")]
)
def test_a_constant_rotation_between_body_frames(rpy_deg: tuple[float, ...], angle: str) -> None:
    estimate = turned(estimated(), transforms.rpy_to_quat(*np.radians(rpy_deg)))
    (line,) = evaluate(drive(), estimate).findings
    assert f"a constant rotation of {angle}" in line
    found = line.partition("--estimate-to-truth=")[2].partition(" ")[0]
    R = transforms.quat_to_matrix(transforms.rpy_to_quat(*np.radians([float(a) for a in found.split(",")])))
    true = transforms.quat_to_matrix(transforms.rpy_to_quat(*np.radians(rpy_deg)))
    assert np.degrees(np.arccos(np.clip((np.trace(R.T @ true) - 1) / 2, -1, 1))) < 0.3


@pytest.mark.parametrize("word", ["auto", "-90,0,-90", "0,0,0,-0.5,0.5,-0.5,0.5"])
def test_the_option_takes_the_rotation_out(tmp_path: Path, word: str, capfd: Capture) -> None:
    truth = write_tum(tmp_path / "truth.tum", drive())
    camera = write_tum(tmp_path / "camera.tum", turned(estimated(), CAMERA))
    assert (
        main(["evaluate", "--json", "--truth", str(truth), str(camera), f"--estimate-to-truth={word}"]) == 0
    )
    (found,) = json.loads(capfd.readouterr().out)["results"]
    plain = evaluate(drive(), estimated())
    assert found["findings"] == []
    for metric in (Metric.APE_ROTATION, Metric.RPE_TRANSLATION):
        assert found["metrics"][metric.name.lower()]["rmse"] == pytest.approx(rmse(plain, metric), rel=0.05)


@pytest.mark.parametrize(
    ("offset_s", "name"),
    [
        (18.0, "leap seconds between GPS time and UTC"),
        (-18.0, "leap seconds between GPS time and UTC"),
        (37.0, "leap seconds between TAI and UTC"),
        (0.5, ""),
    ],
)
def test_a_constant_offset_of_the_clock(offset_s: float, name: str) -> None:
    late = estimated().shifted(round(offset_s * 1e9))
    line = next(line for line in evaluate(drive(), late).findings if "offset" in line)
    assert name in line
    assert float(line.partition("--time-offset=")[2].split()[0]) == pytest.approx(-offset_s, abs=0.02)


def test_whole_hours_are_named_where_nothing_overlaps() -> None:
    with pytest.raises(
        EvaluationError, match=r"\(1 h: whole hours, as between time zones\); use --time-offset"
    ):
        evaluate(drive(), estimated().shifted(3_600_700_000_000))


def test_a_scale_far_from_one(tmp_path: Path, capfd: Capture) -> None:
    small = replace(estimated(), position_m=0.05 * estimated().position_m)
    assert any(
        "a scale of 20" in line and "--align sim3" in line for line in evaluate(drive(), small).findings
    )
    files = [str(write_tum(tmp_path / f"{k}.tum", one)) for k, one in enumerate((drive(), small))]
    assert main(["evaluate", "--align", "sim3", "--truth", *files]) == 0
    printed = capfd.readouterr().out
    assert ", scale 20" in printed
    assert "fitted scale is 20" in printed


IDENTITY, WXYZ_IDENTITY, ZERO, NAN = (
    [row] * 400 for row in ([0, 0, 0, 1], [1, 0, 0, 0], [0] * 4, ["nan"] * 4)
)


@pytest.mark.parametrize(
    "text",
    [
        *(table(S, drive().position_m.tolist(), quat) for quat in (IDENTITY, WXYZ_IDENTITY, ZERO, NAN)),
        table(S, drive().position_m.tolist()),
        table(S, drive().position_m.tolist(), by=","),
        table(S, drive().position_m.tolist(), by="\t", header="# time x y z"),
        table(S, drive().position_m.tolist(), by=";", header="t;x;y;z").replace(".", ","),
        table(S, drive().position_m.tolist(), [[9, 0.4]] * 400, by=",", header="time,x,y,z,satellites,hdop"),
    ],
)  # fmt: skip
def test_truth_without_attitudes_has_errors_of_positions(tmp_path: Path, text: str) -> None:
    (tmp_path / "rtk.txt").write_text(text)
    result, full = (evaluate(t, estimated()) for t in (read_text_trajectory(tmp_path / "rtk.txt"), drive()))
    assert set(result.statistics) == set(OF_POSITIONS)
    assert result.segments == ()
    for metric in OF_POSITIONS:
        assert rmse(result, metric) == pytest.approx(rmse(full, metric), rel=1e-6)
    (line,) = result.findings
    assert "'rtk' has positions, but no attitudes that change" in line


def test_a_straight_path_may_have_a_constant_attitude(tmp_path: Path) -> None:
    line = [[0.8 * k, 0.0, 0.0] for k in range(400)]
    (tmp_path / "a.txt").write_text(table(S, line, IDENTITY))
    assert read_text_trajectory(tmp_path / "a.txt").has_attitudes


def test_a_hole_in_the_truth_counts_by_time() -> None:
    holes = drive().take(np.r_[0:60, 340:400])
    result = evaluate(holes, estimated())
    assert result.coverage == 1.0
    # 28.1 s of 39.9 s have no truth.
    assert result.covered.share == pytest.approx(11.8 / 39.9)
    assert result.covered.longest_gap_s == pytest.approx(28.1)
    assert result.findings == ("pairs cover 30% of the time: none for 28.1 s after 1672531205.900 s",)
    assert str(FailRule().why_failed(result)).startswith("covers 30% of the time")
    every_tenth = drive().take(np.arange(0, 400, 10))
    assert evaluate(every_tenth, estimated()).covered.share > 0.99


@pytest.mark.parametrize(
    ("column", "word", "words"),
    [(6, "4.8012", r"quaternion that is not of length 1 \(line 202\) but of 4\.9.*exponent"),
     (1, "4e12", r"position beyond 1e\+09 m \(line 202\)"),
     (1, "1e300", r"position beyond 1e\+09 m \(line 202\)")],
)  # fmt: skip
def test_an_impossible_pose_is_refused_by_its_line(
    tmp_path: Path, column: int, word: str, words: str
) -> None:
    with pytest.raises(EvaluationError, match=words):
        read_text_trajectory(_with_word(tmp_path, column, word))


def test_an_impossible_position_is_a_finding_with_its_line(tmp_path: Path) -> None:
    (line,) = evaluate(drive(), read_text_trajectory(_with_word(tmp_path, 2, "6130.0"))).findings
    assert "a.tum line 202: impossible position, 6" in line


def _with_word(folder: Path, column: int, word: str) -> Path:
    lines = table(S, P, XYZW, header="# time x y z qx qy qz qw").splitlines()
    words = lines[201].split()
    lines[201] = " ".join([*words[:column], word, *words[column + 1 :]])
    (folder / "a.tum").write_text("\n".join(lines))
    return folder / "a.tum"


@pytest.mark.parametrize("alignment", [Alignment.SE3, Alignment.SIM3, Alignment.POSYAW])
def test_a_car_that_hardly_moved_has_the_rotation_error_of_its_attitudes(alignment: Alignment) -> None:
    truth = replace(drive(), position_m=drive().position_m * 0.2 / drive().length_m)
    noise = np.random.default_rng(3).normal(0.0, 0.03, (400, 3))
    result = evaluate(truth, replace(estimated(), position_m=truth.position_m + noise), alignment=alignment)
    # Noise of 0.017 rad about three axes.
    assert rmse(result, Metric.APE_ROTATION) == pytest.approx(np.degrees(0.017 * np.sqrt(3)), rel=0.1)
    (line,) = result.findings
    assert "'truth' hardly moves (0.2 m)" in line


def test_columns_that_are_no_attitude_are_still_asked_for(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(table(S, P, RPY[:, :2].tolist(), by=",", header="time,x,y,z,roll,pitch"))
    with pytest.raises(EvaluationError, match="names no qx qy qz qw or roll pitch yaw"):
        read_text_trajectory(tmp_path / "a.csv")
