"""Attitude errors: what a straight way leaves open, and how they are found all the same."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from recorder.cli.main import main
from recorder.evaluation.align import attitude_errors_deg
from recorder.evaluation.evaluate import evaluate
from recorder.evaluation.metrics import Metric, errors
from recorder.evaluation.trajectory import Trajectory


def trajectory(position_m: np.ndarray, attitude: Rotation) -> Trajectory:
    stamp_ns = np.arange(len(position_m)) * 100_000_000
    return Trajectory(stamp_ns=stamp_ns, position_m=position_m, quat_xyzw=attitude.as_quat(), name="t")


@pytest.mark.parametrize("beside_m", [1e-3, 0.0], ids=["nearly straight", "a line"])
def test_a_straight_way_leaves_the_roll_open_to_positions_but_not_to_attitudes(
    beside_m: float, tmp_path: Path, caplog: pytest.LogCaptureFixture, capsys: pytest.CaptureFixture[str]
) -> None:
    """Millimetres of noise beside a straight way turn evo's rotation error; attitudes are without a flaw."""
    draw = np.random.default_rng(2)
    way = np.column_stack([np.linspace(0.0, 50.0, 300), np.zeros((300, 2))])
    attitude = Rotation.from_euler("z", draw.normal(0.0, 0.1, (300, 1)))
    truth = trajectory(way + draw.normal(0.0, beside_m, (300, 3)), attitude)
    start = Rotation.from_euler("xyz", [0.3, -0.2, 1.0])
    noisy = start.apply(way + draw.normal(0.0, 1e-3, (300, 3)))
    estimate = trajectory(noisy, start * attitude)
    result = evaluate(truth, estimate)
    assert result.statistics[Metric.APE_TRANSLATION].rmse < 0.005
    assert attitude_errors_deg(result.truth, result.estimate).max() < 1e-5
    # The alignment itself is that of positions, with any roll; its direction is right to 1 mm in 50 m.
    assert errors(Metric.APE_ROTATION, result.truth, result.estimate).max() > 5.0
    assert result.roll_from_attitudes
    assert result.statistics[Metric.APE_ROTATION].max < 0.002
    assert caplog.text == "", "a benchmark reports nothing that depends on the roll"
    for name, poses in (("truth", truth), ("estimate", estimate)):
        times_s = poses.stamp_ns[:, None] / 1e9
        np.savetxt(tmp_path / name, np.column_stack([times_s, poses.position_m, poses.quat_xyzw]))
    words = ["evaluate", "--truth", str(tmp_path / "truth"), *[str(tmp_path / "estimate")] * 2]
    assert main(words) == 0
    assert capsys.readouterr().out.count("nearly straight path") == 1


def test_a_bend_leaves_no_roll_open() -> None:
    """Attitudes that are wrong by a constant turn about the way stay wrong where positions tell."""
    angle = np.linspace(0.0, 1.0, 200)
    way = 40.0 * np.column_stack([np.sin(angle), 1.0 - np.cos(angle), 0.0 * angle])
    attitude = Rotation.from_euler("z", angle[:, None])
    rolled = attitude * Rotation.from_euler("x", 10.0, degrees=True)
    result = evaluate(trajectory(way, attitude), trajectory(way, rolled))
    assert not result.roll_from_attitudes
    assert result.statistics[Metric.APE_ROTATION].mean == pytest.approx(10.0, abs=1e-6)


def test_a_yaw_error_on_a_line_is_not_fitted_away() -> None:
    """Only the roll is open: 5° between the way and the attitudes stay 5°."""
    way = np.column_stack([np.linspace(0.0, 50.0, 100), np.zeros((100, 2))])
    straight = Rotation.from_euler("z", np.zeros((100, 1)))
    wrong = Rotation.from_euler("xz", [30.0, 5.0], degrees=True) * straight
    turned = Rotation.from_euler("z", 70.0, degrees=True)
    result = evaluate(trajectory(way, straight), trajectory(turned.apply(way), turned * wrong))
    assert result.statistics[Metric.APE_ROTATION].mean == pytest.approx(5.0, abs=1e-6)


def test_a_known_error_is_found() -> None:
    """Errors of ±a about one axis: no fit makes them smaller than a."""
    attitude = Rotation.random(100, random_state=4)
    way = np.random.default_rng(1).normal(size=(100, 3))
    sign = np.tile([1.0, -1.0], 50)
    wrong = Rotation.from_rotvec(np.radians(3.0) * sign[:, None] * [0.0, 0.0, 1.0]) * attitude
    turned = Rotation.from_euler("x", 40, degrees=True) * wrong
    errors = attitude_errors_deg(trajectory(way, attitude), trajectory(way, turned))
    assert errors == pytest.approx(np.full(100, 3.0), abs=1e-6)
