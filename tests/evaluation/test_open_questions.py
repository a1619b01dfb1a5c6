"""What a file does not say is taken as it is likeliest, with a word, or asked for in one line."""

from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.readings.pose_tables import DRESSINGS, MATRIX, NUMBER, RPY, XYZW, P, S, estimated, table

from carlaloc_env.core import transforms
from carlaloc_env.core.errors import EvaluationError
from recorder.evaluation.associate import Association, interpolation
from recorder.evaluation.evaluate import evaluate
from recorder.evaluation.metrics import Metric
from recorder.evaluation.quaternion_order import as_xyzw, order_by_motion
from recorder.evaluation.stamp_units import unit_of_stamps
from recorder.evaluation.trajectory import Trajectory
from recorder.evaluation.trajectory_files import read_text_trajectory


def _written(folder: Path, text: str, name: str = "a.txt") -> Path:
    (folder / name).write_text(text)
    return folder / name


@pytest.mark.parametrize(
    ("dressing", "words"),
    [
        ("TUM", None),
        ("TUM without a header, called csv", None),
        ("EuRoC", None),
        ("MCD", None),
        ("rostopic echo -p", "read as nanoseconds"),
        ("KITTI with times", None),
        ("TUM in microseconds", "read as microseconds"),
        ("TUM in milliseconds", "read as milliseconds"),
        ("TUM with w first", "read as w x y z, since the body then moves in one direction"),
        ("commas", "read as x y z w, since the body then moves in one direction"),
        ("MCD without a header", "first column is a running number"),
        ("TUM with lost poses", "1 of 401 poses are not finite"),
        ("TUM, each pose written twice", "400 of 800 poses share a stamp"),
        ("TUM backwards", "sorted"),
        ("TUM with few digits", "too few digits"),
        ("angles in radians", "radians, by their size"),
    ],
)
def test_only_what_is_open_is_reported(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, dressing: str, words: str | None
) -> None:
    (tmp_path / "times.txt").write_text("\n".join(S))
    few = ("a.tum", table([f"{float(s):g}" for s in S], P, XYZW))
    name, text = DRESSINGS.get(dressing, few)
    read_text_trajectory(_written(tmp_path, text, name))
    if words is None:
        assert caplog.text == ""
    else:
        assert words in caplog.text


def test_options_overrule_what_would_be_taken(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = _written(tmp_path, table(NUMBER, P, XYZW))
    read = read_text_trajectory(path, quaternion="wxyz", time_unit="ms")
    assert read.stamp_ns.tolist() == [1_000_000 * i for i in range(400)]
    np.testing.assert_allclose(read.quat_xyzw, np.roll(XYZW, -1, axis=1), atol=1e-12)
    assert caplog.text == ""
    for option in ({"quaternion": "xyz"}, {"time_unit": "h"}):
        with pytest.raises(EvaluationError, match="Known: "):
            read_text_trajectory(path, **option)


def test_neighbours_turn_alike_in_both_orders_and_only_the_way_tells_them_apart() -> None:
    """The angle from one attitude to the next comes of a scalar product, which no permutation changes."""
    quat, position = estimated().quat_xyzw, estimated().position_m

    def turns(q: np.ndarray) -> np.ndarray:
        step = transforms.quat_multiply(transforms.quat_conjugate(q[:-1]), q[1:])
        return np.linalg.norm(transforms.quat_to_rotvec(step), axis=1)

    np.testing.assert_allclose(turns(quat), turns(as_xyzw(quat, "wxyz")), atol=1e-7)
    assert order_by_motion(position, quat) == "xyzw"
    assert order_by_motion(position, quat[:, [3, 0, 1, 2]]) == "wxyz"
    # A drone that turns about itself on a line, and a hand that shakes: the motion shows nothing.
    line = np.outer(np.arange(400.0), [1.0, 0.0, 0.0])
    assert order_by_motion(line, quat) is None
    shaken = np.random.default_rng(5).normal(size=(400, 3))
    assert order_by_motion(shaken, quat) is None
    assert order_by_motion(np.zeros((400, 3)), quat) is None


@pytest.mark.parametrize("scale", ["s", "ms", "us", "ns"])
@pytest.mark.parametrize("start_s", [0.0, 4000.0, 1.35e9, 1.6725312e9])
@pytest.mark.parametrize("step_s", [0.005, 0.1, 1.0])
def test_units_of_whole_stamps(scale: str, start_s: float, step_s: float) -> None:
    """Clocks since 1970, 1980 or the start of a machine, 1 to 200 Hz."""
    per_s = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[scale]
    stamps = (
        np.round((start_s + step_s * np.arange(50)) * per_s)
        if scale != "s"
        else start_s + step_s * np.arange(50)
    )
    assert unit_of_stamps(stamps) == scale


def test_a_unit_by_name_counts_unless_it_is_absurd() -> None:
    assert unit_of_stamps(np.arange(0.0, 5000.0, 50.0), "ms") == "ms"
    assert unit_of_stamps(np.arange(0.0, 5e9, 5e7), "ns") == "ns"
    assert unit_of_stamps(1672531200.0 + 0.05 * np.arange(100), "ns") == "s"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (table(S, P, XYZW) + table(S, P, XYZW), "2 runs: stamps jump back by 39.9 s after pose 400"),
        (table(S, P, RPY[:, :2].tolist()), "line 1 is not 'time tx ty tz qx qy qz qw'"),
        (table(NUMBER, P, XYZW, by=",", header="num,x,y,z,qx,qy,qz,qw"), "names no time;"),
        (table(S, P, XYZW, by=",", header="time,lat,lon,alt,qx,qy,qz,qw"), "names no x y z;"),
        (
            table(S, P, XYZW, by=",", header="time,x [mm],y [mm],z [mm],qx,qy,qz,qw"),
            "names no x y z in metres",
        ),
        (table(S, P, XYZW, by=",", header="time,x,y,z,qx,qy,qz"), "has not the 8 columns of its rows"),
        (table(S, P, XYZW, header="this is a trajectory of mine"), "has not the 8 columns"),
        (table(S, P, XYZW) + "1672531250.0 1 2\n", "line 401 is not"),
        (table(S, P, [[0.5, 0.5, 0.5, 0.9]] * 400), r"not of length 1 \(line 1\)"),
        ("# only a comment\n", "no pose"),
        ("{}", "no pose"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(EvaluationError, match=words):
        read_text_trajectory(_written(tmp_path, text))


def test_matrices_that_mirror_or_scale_are_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "times.txt").write_text("\n".join(S))

    def kitti(factor: np.ndarray, digits: int = 17) -> Path:
        return _written(
            tmp_path, table([[f"{v:.{digits}g}" for v in row] for row in (MATRIX * factor).tolist()])
        )

    with pytest.raises(EvaluationError, match=r"left-handed: the matrix of pose 1 mirrors"):
        read_text_trajectory(kitti(np.tile([1.0, 1.0, -1.0, 1.0], 3)))
    with pytest.raises(EvaluationError, match=r"no rotation \(pose \d+: .* 0\.21\)"):
        read_text_trajectory(kitti(np.tile([1.1, 1.1, 1.1, 1.0], 3)))
    read_text_trajectory(kitti(np.ones(12), digits=6))
    assert caplog.text == ""
    read = read_text_trajectory(kitti(np.tile([1.01, 1.01, 1.01, 1.0], 3)))
    assert "nearest rotations are taken" in caplog.text
    np.testing.assert_allclose(
        np.abs(np.sum(read.quat_xyzw * estimated().quat_xyzw, axis=1)), 1.0, atol=1e-12
    )


def _sparse(offset_ns: int) -> tuple[Trajectory, Trajectory]:
    """A truth of 1 Hz, and an estimate of 10 Hz whose stamps miss it; both on one circle."""

    def circle(stamp_ns: np.ndarray, name: str) -> Trajectory:
        angle = (stamp_ns - 1_672_531_200 * 10**9) * 1e-9 * 0.2
        position = 20.0 * np.stack([np.sin(angle), 1.0 - np.cos(angle), 0.1 * np.sin(3 * angle)], axis=1)
        zero = np.zeros_like(angle)
        return Trajectory(
            stamp_ns=stamp_ns,
            position_m=position,
            quat_xyzw=transforms.rpy_to_quat(zero, zero, angle),
            name=name,
        )

    start = 1_672_531_200 * 10**9
    truth = circle(start + offset_ns + np.arange(19, dtype=np.int64) * 10**9, "truth")
    return truth, circle(start + np.arange(200, dtype=np.int64) * 10**8, "estimate")


def test_sparse_truth_is_paired_by_the_options_that_the_refusal_names(
    caplog: pytest.LogCaptureFixture,
) -> None:
    truth, estimate = _sparse(37_000_000)
    with pytest.raises(EvaluationError, match=r"pair them by --interpolate, or by --max-gap 0\.037"):
        evaluate(truth, estimate)
    near = evaluate(truth, estimate, max_gap_ns=37_000_000)
    assert (near.matched, near.expected) == (19, 19)
    assert "up to 37 ms apart" in caplog.text
    method, gap_ns = interpolation(truth, estimate)
    assert method is Association.ESTIMATE_INTERPOLATED
    between = evaluate(truth, estimate, association=method, max_gap_ns=gap_ns)
    assert (between.matched, between.expected) == (19, 19)
    # A chord of 0.1 s at 4 m/s lies c²/8r = 1 mm from a circle of 20 m, and as much from the wave on it.
    assert between.statistics[Metric.APE_TRANSLATION].max < 0.002
    assert near.statistics[Metric.APE_TRANSLATION].max > 0.03
    assert interpolation(estimate, truth)[0] is Association.INTERPOLATED


def test_few_pairs_by_chance_are_reported(caplog: pytest.LogCaptureFixture) -> None:
    """Truth at 1.01 Hz: some of its stamps happen to lie near one of the estimate's, most do not."""
    truth, estimate = _sparse(0)
    drifting = Trajectory(
        stamp_ns=truth.stamp_ns + np.arange(19) * 7_000_000,
        position_m=truth.position_m, quat_xyzw=truth.quat_xyzw, name="truth",
    )  # fmt: skip
    evaluate(drifting, estimate)
    assert "poses without a partner; pair them by --interpolate" in caplog.text
