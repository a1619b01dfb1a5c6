"""Scores against closed forms and against evo."""

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from carlaloc_env.core import transforms
from carlaloc_env.core.errors import EvaluationError
from recorder.evaluation.align import Alignment, umeyama
from recorder.evaluation.associate import Association, associate
from recorder.evaluation.evaluate import evaluate
from recorder.evaluation.metrics import Metric
from recorder.evaluation.trajectory import Trajectory
from recorder.evaluation.trajectory_files import read_tum

EPOCH_NS = 1_672_531_200_000_000_000


def drive(count: int = 4000, step_ns: int = 5_000_000) -> Trajectory:
    """A winding road with hills, 200 Hz."""
    t = np.arange(count) * step_ns * 1e-9
    yaw = 0.8 * np.sin(0.3 * t)
    velocity = np.stack([10 * np.cos(yaw), 10 * np.sin(yaw), np.sin(0.5 * t)], axis=1)
    position = np.cumsum(velocity, axis=0) * step_ns * 1e-9 + [300.0, -200.0, 12.0]
    quat = transforms.rpy_to_quat(0.02 * np.sin(t), -0.1 * np.sin(0.5 * t), yaw)
    stamps = EPOCH_NS + np.arange(count, dtype=np.int64) * step_ns
    return Trajectory(stamp_ns=stamps, position_m=position, quat_xyzw=quat, name="truth")


def moved(trajectory: Trajectory, T: np.ndarray, scale: float = 1.0) -> Trajectory:
    """The trajectory in another world: x = scale · R p + t."""
    return Trajectory(
        stamp_ns=trajectory.stamp_ns,
        position_m=transforms.apply(T, scale * trajectory.position_m),
        quat_xyzw=transforms.quat_multiply(transforms.matrix_to_quat(T[:3, :3]), trajectory.quat_xyzw),
        name="estimate",
    )


def noisy(trajectory: Trajectory, seed: int = 0) -> Trajectory:
    rng = np.random.default_rng(seed)
    turn = transforms.rotvec_to_quat(rng.normal(0, 0.02, (len(trajectory), 3)))
    return Trajectory(
        stamp_ns=trajectory.stamp_ns,
        position_m=trajectory.position_m + rng.normal(0, 0.1, (len(trajectory), 3)),
        quat_xyzw=transforms.quat_multiply(trajectory.quat_xyzw, turn),
        name="noisy",
    )


def write(path: Path, trajectory: Trajectory) -> Path:
    rows = zip(
        trajectory.stamp_ns.tolist(),
        trajectory.position_m.tolist(),
        trajectory.quat_xyzw.tolist(),
        strict=True,
    )
    path.write_text(
        "".join(f"{s // 10**9}.{s % 10**9:09d} " + " ".join(map(repr, (*p, *q))) + "\n" for s, p, q in rows)
    )
    return path


def test_truth_against_itself_is_zero() -> None:
    result = evaluate(drive(), drive(), alignment=Alignment.NONE)
    for metric in Metric:
        assert result.statistics[metric].max < (1e-5 if metric.unit == "deg" else 1e-12)
    assert result.coverage == 1.0


@settings(max_examples=20, deadline=None)
@given(
    rotvec=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    shift=st.tuples(*[st.floats(-1e4, 1e4)] * 3),
    scale=st.floats(0.1, 10.0),
)
def test_known_transform_is_recovered(
    rotvec: tuple[float, float, float], shift: tuple[float, float, float], scale: float
) -> None:
    truth = drive(400, 50_000_000)
    T = transforms.transform(shift, transforms.rotvec_to_quat(rotvec))
    rigid = evaluate(truth, moved(truth, T))
    assert rigid.statistics[Metric.APE_TRANSLATION].max < 1e-7
    assert rigid.statistics[Metric.APE_ROTATION].max < 1e-5
    assert np.allclose(rigid.transform.R, T[:3, :3].T, atol=1e-9)
    scaled = evaluate(truth, moved(truth, T, scale), alignment=Alignment.SIM3)
    assert scaled.transform.scale == pytest.approx(1 / scale, rel=1e-9)
    assert scaled.statistics[Metric.APE_TRANSLATION].max < 1e-7
    assert rigid.transform.scale == 1.0


def test_yaw_alignment_leaves_a_tilt() -> None:
    """Rules out an SE(3) fit under the name of a fit in position and yaw."""
    truth = drive(400, 50_000_000)
    T_yaw = transforms.transform((5.0, 6.0, 7.0), transforms.rpy_to_quat(0.0, 0.0, 2.0))
    result = evaluate(truth, moved(truth, T_yaw), alignment=Alignment.POSYAW)
    assert result.statistics[Metric.APE_TRANSLATION].max < 1e-9
    T_tilt = transforms.transform((0.0, 0.0, 0.0), transforms.rpy_to_quat(0.1, 0.0, 0.0))
    tilted = evaluate(truth, moved(truth, T_tilt), alignment=Alignment.POSYAW)
    assert tilted.statistics[Metric.APE_ROTATION].median == pytest.approx(np.degrees(0.1), abs=0.5)
    assert tilted.statistics[Metric.APE_TRANSLATION].max > 0.5


def test_known_errors_without_alignment() -> None:
    """A shift is all APE and no RPE; a stretch of 1 % is 1 % of every step."""
    truth = drive(400, 50_000_000)
    T = transforms.transform((3.0, 4.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    shifted = evaluate(truth, moved(truth, T), alignment=Alignment.NONE)
    assert shifted.statistics[Metric.APE_TRANSLATION].rmse == pytest.approx(5.0, abs=1e-9)
    for metric in (Metric.RPE_PAPER, Metric.RPE_TRANSLATION, Metric.RPE_POINT_DISTANCE):
        assert shifted.statistics[metric].max < 1e-9
    stretched = evaluate(truth, moved(truth, np.eye(4), 1.01), alignment=Alignment.NONE)
    steps = np.linalg.norm(np.diff(truth.position_m, axis=0), axis=1)
    for metric in (Metric.RPE_PAPER, Metric.RPE_TRANSLATION, Metric.RPE_POINT_DISTANCE):
        assert np.allclose(stretched.values[metric], 0.01 * steps, atol=1e-9)
    assert all(s.translation_percent == pytest.approx(1.0, abs=0.1) for s in stretched.segments)
    assert [s.length_m for s in stretched.segments] == [50.0, 100.0]


def test_turned_world_separates_the_relative_metrics() -> None:
    """Unaligned, the paper's RPE sees a turned world; evo's definitions do not."""
    truth = drive(400, 50_000_000)
    T = transforms.transform((0.0, 0.0, 0.0), transforms.rpy_to_quat(0.0, 0.0, np.pi))
    result = evaluate(truth, moved(truth, T), alignment=Alignment.NONE)
    assert result.statistics[Metric.RPE_TRANSLATION].max < 1e-9
    assert result.statistics[Metric.RPE_POINT_DISTANCE].max < 1e-9
    step = np.linalg.norm(np.diff(truth.position_m[:, :2], axis=0), axis=1)
    assert np.allclose(result.values[Metric.RPE_PAPER], 2 * step)


def test_lever_arm() -> None:
    """An estimate of the camera scores zero when the lever arm is given and does not when it is not."""
    truth = drive(400, 50_000_000)
    T_body_camera = transforms.transform((1.5, 0.2, 0.8), transforms.rpy_to_quat(0.0, 0.1, 0.3))
    camera = truth.of_sensor(T_body_camera)
    with_arm = evaluate(truth, camera, alignment=Alignment.NONE, T_body_sensor=T_body_camera)
    assert with_arm.statistics[Metric.APE_TRANSLATION].max < 1e-12
    assert evaluate(truth, camera).statistics[Metric.APE_TRANSLATION].rmse > 0.05


@pytest.mark.parametrize(
    "position", [np.zeros((50, 3)), np.repeat([[1e5, 2e5, 3e5]], 50, axis=0)], ids=["point", "far point"]
)
def test_degenerate_paths_are_refused(position: np.ndarray) -> None:
    quat = np.tile([0.0, 0.0, 0.0, 1.0], (50, 1))
    still = Trajectory(stamp_ns=np.arange(50) * 10**8, position_m=position, quat_xyzw=quat, name="x")
    with pytest.raises(EvaluationError, match="not determined"):
        evaluate(still, still)
    assert evaluate(still, still, alignment=Alignment.NONE).statistics[Metric.APE_TRANSLATION].max == 0


def test_too_few_or_no_pairs_are_refused() -> None:
    truth = drive(400, 50_000_000)
    with pytest.raises(EvaluationError, match="needs 3"):
        evaluate(truth, truth.take(np.arange(2)))
    with pytest.raises(EvaluationError, match="--time-offset search"):
        evaluate(truth, truth.shifted(3600 * 10**9))
    with pytest.raises(EvaluationError, match="more than 1"):
        evaluate(truth, truth.take(np.arange(1)), alignment=Alignment.NONE)


def test_mirrored_points_give_a_rotation() -> None:
    """Umeyama's sign: the best orthogonal map of a mirror image must not be a mirror."""
    x = np.random.default_rng(0).normal(size=(100, 3))
    R = umeyama(x, x * [1.0, 1.0, -1.0]).R
    assert np.linalg.det(R) == pytest.approx(1.0)


def test_coverage_counts_what_is_missing() -> None:
    truth = drive(4000)
    estimate = truth.take(np.arange(0, 2000, 10))
    result = evaluate(truth, estimate)
    assert result.matched == 200
    assert result.coverage == pytest.approx(0.5, abs=0.002)
    assert evaluate(truth, estimate, expected=250).coverage == 0.8
    whole = evaluate(truth, truth.take(np.arange(0, 4000, 10)))
    assert whole.matched == whole.expected == 400


def test_interpolated_truth_beats_the_nearest() -> None:
    """Between 5 ms truths 10 m/s are up to 25 mm; on a straight stretch interpolation leaves none."""
    truth = drive(4000)
    t = truth.stamp_ns[100:3900:20] + 2_499_000
    between = Trajectory(
        stamp_ns=t,
        position_m=np.stack([np.interp(t, truth.stamp_ns, truth.position_m[:, k]) for k in range(3)], axis=1),
        quat_xyzw=truth.quat_xyzw[100:3900:20],
        name="between",
    )
    nearest = evaluate(truth, between, alignment=Alignment.NONE)
    linear = evaluate(truth, between, alignment=Alignment.NONE, association=Association.INTERPOLATED)
    assert 0.02 < nearest.statistics[Metric.APE_TRANSLATION].median < 0.03
    assert linear.statistics[Metric.APE_TRANSLATION].max < 1e-4
    late = evaluate(
        truth,
        between.shifted(50_000_000),
        alignment=Alignment.NONE,
        association=Association.INTERPOLATED,
        time_offset_ns=-50_000_000,
    )
    assert late.values[Metric.APE_TRANSLATION].tolist() == linear.values[Metric.APE_TRANSLATION].tolist()


def test_interpolation_does_not_leave_the_truth() -> None:
    truth = drive(100)
    outside = truth.shifted(-100_000_000)
    matched, pairs = associate(truth, outside, Association.INTERPOLATED)
    assert pairs.stamp_ns[0] == truth.stamp_ns[0]
    assert len(matched) == 80
    assert np.array_equal(matched.position_m, truth.position_m[:80])


def test_tum_files(tmp_path: Path) -> None:
    truth = drive(100)
    read = read_tum(write(tmp_path / "a.tum", truth))
    assert np.array_equal(read.stamp_ns, truth.stamp_ns)
    assert np.array_equal(read.position_m, truth.position_m)
    (tmp_path / "orb.txt").write_text("1672531200050000000.000000 1 2 3 0 0 0 1\n# end\n")
    assert read_tum(tmp_path / "orb.txt").stamp_ns.tolist() == [1672531200050000000]
    (tmp_path / "sci.txt").write_text("1.672531200050e+09 1 2 3 0 0 0 1\n")
    assert read_tum(tmp_path / "sci.txt").stamp_ns.tolist() == [1672531200050000000]


def _evo(trajectory: Trajectory) -> Any:
    evo_trajectory = pytest.importorskip("evo.core.trajectory")
    return evo_trajectory.PoseTrajectory3D(
        positions_xyz=trajectory.position_m.copy(),
        orientations_quat_wxyz=np.roll(trajectory.quat_xyzw, 1, axis=1),
        timestamps=(trajectory.stamp_ns - EPOCH_NS) * 1e-9,
    )


@pytest.mark.parametrize("alignment", [Alignment.NONE, Alignment.SE3, Alignment.SIM3])
@pytest.mark.parametrize("case", ["dense", "sparse", "gaps"])
def test_agrees_with_evo(alignment: Alignment, case: str) -> None:
    metrics = pytest.importorskip("evo.core.metrics")
    sync = pytest.importorskip("evo.core.sync")
    truth = drive(4000)
    T = transforms.transform((20.0, -7.0, 3.0), transforms.rpy_to_quat(0.1, -0.3, 2.0))
    estimate = noisy(moved(truth, T, 1.05)).shifted(1_700_000)
    if case != "dense":
        estimate = estimate.take(np.arange(3, 4000, 10))
    if case == "gaps":
        estimate = estimate.take(np.flatnonzero(np.random.default_rng(1).random(len(estimate)) < 0.7))
        truth = truth.take(np.flatnonzero(np.random.default_rng(2).random(4000) < 0.3))
    ours = evaluate(truth, estimate, alignment=alignment)
    ref, est = sync.associate_trajectories(_evo(truth), _evo(estimate), max_diff=0.01)
    est = copy.deepcopy(est)
    if alignment is not Alignment.NONE:
        est.align(ref, correct_scale=alignment is Alignment.SIM3)
    assert ref.num_poses == ours.matched
    relation = metrics.PoseRelation
    pairs = [
        (Metric.APE_TRANSLATION, metrics.APE(relation.translation_part)),
        (Metric.APE_ROTATION, metrics.APE(relation.rotation_angle_deg)),
        (Metric.RPE_TRANSLATION, metrics.RPE(relation.translation_part)),
        (Metric.RPE_POINT_DISTANCE, metrics.RPE(relation.point_distance)),
        (Metric.RPE_ROTATION, metrics.RPE(relation.rotation_angle_deg)),
    ]
    for metric, theirs in pairs:
        theirs.process_data((ref, est))
        assert np.abs(ours.values[metric] - theirs.error).max() < 1e-9, metric
        statistics = theirs.get_all_statistics()
        for name in ("rmse", "mean", "median", "std", "min", "max"):
            assert abs(getattr(ours.statistics[metric], name) - statistics[name]) < 1e-9, (metric, name)


def test_result_is_labelled() -> None:
    mapping = evaluate(drive(), noisy(drive())).to_mapping()
    assert mapping["alignment"] == "SE(3) Umeyama"
    assert mapping["association"] == "nearest in time"
    assert "world-frame" in mapping["metrics"]["rpe_paper"]["label"]
    assert mapping["metrics"]["ape_rotation"]["unit"] == "deg"


def test_causes_are_named_on_long_drives_too() -> None:
    """Where only every third pair is looked at: a rotation of 10° between the frames."""
    truth = drive(30_000)
    turn = np.tile(transforms.rpy_to_quat(np.radians(10.0), 0.0, 0.0), (len(truth), 1))
    estimate = Trajectory(
        stamp_ns=truth.stamp_ns,
        position_m=truth.position_m + np.random.default_rng(1).normal(0.0, 0.02, truth.position_m.shape),
        quat_xyzw=transforms.quat_multiply(truth.quat_xyzw, turn),
        name="turned",
    )
    (line,) = evaluate(truth, estimate).findings
    assert "a constant rotation of 10.0°" in line
