"""An odometry whose noise is known: its errors and covariances on SE(3), in files and by smfeval."""

import csv
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.transforms import (
    from_rotation,
    invert,
    matrix_to_quat,
    quat_to_matrix,
    rpy_to_quat,
    transform,
)
from recorder.cli.main import main
from recorder.evaluation.covariance_files import read_covariances, write_covariances
from recorder.evaluation.se3 import adjoint, composed_covariance, cross_matrix, log_se3, moved_covariance
from recorder.evaluation.trajectory import Trajectory
from recorder.evaluation.trajectory_files import read_tum, write_tum
from recorder.laboratory.pose_errors import Run, pose_errors
from recorder.laboratory.pose_statistics import consistency_of

STEP_NOISE = np.diag([0.02, 0.01, 0.01, 0.001, 0.001, 0.002]) ** 2
STEP_NOISE[0, 5] = STEP_NOISE[5, 0] = 1e-5
"""Covariance of a step; steps of 1 m on a bend."""
RUNS, STEPS = 200, 80


def hat(xi: Array) -> Array:
    """Matrices of the Lie algebra, (..., 6) to (..., 4, 4)."""
    found = np.zeros((*xi.shape[:-1], 4, 4))
    found[..., :3, :3], found[..., :3, 3] = cross_matrix(xi[..., 3:]), xi[..., :3]
    return found


def exponential(xi: Array) -> Array:
    """By its series, for many at once: a twentieth of SciPy's time; terms fall below 1e-16 for |ξ| < 8."""
    term = found = np.broadcast_to(np.eye(4), (*xi.shape[:-1], 4, 4))
    for k in range(1, 40):
        term = term @ hat(xi) / k
        found = found + term
    return found


def trajectory(T: Array) -> Trajectory:
    """Poses every 0.1 s."""
    stamps = 10**18 + np.arange(len(T)) * 100_000_000
    return Trajectory(stamp_ns=stamps, position_m=T[:, :3, 3].copy(), quat_xyzw=matrix_to_quat(T[:, :3, :3]))


@pytest.fixture(scope="module")
def odometry() -> tuple[Trajectory, list[Run]]:
    """Truth, and runs whose steps have independent errors of `STEP_NOISE` and begin anywhere."""
    random = np.random.default_rng(0)
    step = from_rotation(quat_to_matrix(rpy_to_quat(0.0, 0.01, 0.02)), (1.0, 0.0, 0.0))
    true = [np.eye(4)]
    T, covariance = [exponential(random.normal(size=(RUNS, 6)))], [np.zeros((RUNS, 6, 6))]
    for _ in range(STEPS):
        true.append(true[-1] @ step)
        moved = step @ exponential(random.multivariate_normal(np.zeros(6), STEP_NOISE, RUNS))
        T.append(T[-1] @ moved)
        covariance.append(composed_covariance(covariance[-1], moved, STEP_NOISE))
    runs = [
        Run(estimate=trajectory(poses), covariance=stated)
        for poses, stated in zip(np.stack(T, axis=1), np.stack(covariance, axis=1), strict=True)
    ]
    return trajectory(np.array(true)), runs


def test_the_logarithm_and_the_adjoint_are_those_of_the_exponential() -> None:
    """Against SciPy's matrix exponential, near zero as well: T exp(ξ) T⁻¹ = exp(Ad(T) ξ)."""
    random = np.random.default_rng(1)
    xi = random.normal(size=(50, 6)) * np.logspace(-9, 0, 50)[:, None]
    T = expm(hat(xi))
    assert exponential(xi) == pytest.approx(T, abs=1e-12)
    assert log_se3(T) == pytest.approx(xi, rel=1e-7, abs=1e-14)
    mapped = (adjoint(T) @ xi[::-1, :, None])[..., 0]
    assert T @ expm(hat(xi[::-1])) @ invert(T) == pytest.approx(expm(hat(mapped)), abs=1e-9)


def test_a_composed_odometry_is_consistent_and_half_its_covariance_is_found(
    odometry: tuple[Trajectory, list[Run]],
) -> None:
    truth, runs = odometry
    for factor in (1.0, 0.5):
        stated = [replace(run, covariance=factor * run.covariance) for run in runs]
        for errors in pose_errors(truth, stated, over_m=10.0):
            assert errors.covariance is not None
            found = consistency_of(errors.error, errors.covariance)
            assert found.scale.value == pytest.approx(1.0 / factor, rel=0.12), errors.kind
            assert found.noise_scale.value == pytest.approx(1.0 / factor, rel=0.12)
            if factor == 1.0:
                assert found.coverage[0.9].value == pytest.approx(0.9, abs=0.03)
    over = pose_errors(truth, runs, over_m=10.0)[1]
    assert over.error.shape == (RUNS, 8, 6)


def test_errors_of_a_sensor_are_those_of_the_car_in_its_axes(odometry: tuple[Trajectory, list[Run]]) -> None:
    """A sensor that looks to the left and sits ahead: NEES stays, "along" becomes the car's."""
    truth, runs = odometry
    T_base_sensor = from_rotation(quat_to_matrix(rpy_to_quat(0.0, 0.0, np.pi / 2)), (1.5, 0.0, 1.8))
    sensed = [
        Run(
            estimate=run.estimate.of_sensor(T_base_sensor),
            covariance=moved_covariance(invert(T_base_sensor), run.covariance),
        )
        for run in runs[:5]
    ]
    of_car = pose_errors(truth, runs[:5], over_m=10.0)[0]
    of_sensor = pose_errors(truth.of_sensor(T_base_sensor), sensed, over_m=10.0, T_base_frame=T_base_sensor)[
        0
    ]
    assert of_sensor.error == pytest.approx(of_car.error, abs=1e-9)
    assert of_sensor.covariance == pytest.approx(of_car.covariance, abs=1e-12)


def test_files_keep_covariances_and_faults_are_named(
    odometry: tuple[Trajectory, list[Run]], tmp_path: Path
) -> None:
    estimate, covariance = odometry[1][0].estimate, odometry[1][0].covariance
    assert covariance is not None
    file = write_covariances(tmp_path / "a.tum", estimate, covariance)
    found = read_covariances(tmp_path / "a.tum", estimate)
    assert found == pytest.approx(covariance, rel=1e-12, abs=1e-18)
    assert read_covariances(tmp_path / "none.tum", estimate) is None
    text = file.read_text()
    for change, message in (
        (("right_perturbation", "left_perturbation"), "write right_perturbation"),
        ((text.splitlines()[-1], ""), "a row for each of 81 poses"),
        ((text.splitlines()[-1], "17.5 1.0"), "line 84 is no stamp"),
    ):
        file.write_text(text.replace(*change))
        with pytest.raises(EvaluationError, match=message):
            read_covariances(tmp_path / "a.tum", estimate)


def test_smfeval_finds_the_same(odometry: tuple[Trajectory, list[Run]], tmp_path: Path) -> None:
    """Its translation NEES and coverage of one run, by its own program and its own reader of our file."""
    pytest.importorskip("smfeval", reason="another implementation: pip install smfeval")
    truth, runs = odometry
    covariance = 0.25 * runs[0].covariance[1:] + 1e-6 * np.eye(6)  # type: ignore[index]
    T = transform(runs[0].estimate.position_m, runs[0].estimate.quat_xyzw)
    estimate = trajectory(invert(T[0]) @ T).take(np.arange(1, STEPS + 1))
    write_tum(tmp_path / "est.tum", estimate)
    write_covariances(tmp_path / "est.tum", estimate, covariance)
    write_tum(tmp_path / "ref.tum", truth)
    frames = "--est-body-frame imu --ref-body-frame imu"
    words = f"nees est.tum ref.tum --cov est.cov {frames} --align none --json".split()
    program = "import sys; from smfeval.cli.main import main; sys.exit(main())"
    ended = subprocess.run(
        [sys.executable, "-c", program, *words], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    theirs = json.loads(ended.stdout)
    read = read_tum(tmp_path / "est.tum")
    run = Run(estimate=read, covariance=read_covariances(tmp_path / "est.tum", read))
    errors = pose_errors(truth, [run], over_m=10.0, tied=False)[0]
    assert errors.covariance is not None
    ours = consistency_of(errors.error[..., :3], errors.covariance[..., :3, :3])
    assert np.median(ours.nees) == pytest.approx(theirs["median_nees"], rel=1e-6)
    assert ours.coverage[0.9].value == pytest.approx(theirs["coverage"], abs=1e-9)


def test_the_command_compares_files(
    odometry: tuple[Trajectory, list[Run]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth, runs = odometry
    write_tum(tmp_path / "truth.tum", truth)
    for k, run in enumerate(runs[:20]):
        write_tum(tmp_path / f"{k}.tum", run.estimate)
        write_covariances(tmp_path / f"{k}.tum", run.estimate, 0.25 * run.covariance)  # type: ignore[operator]
    files = [str(tmp_path / f"{k}.tum") for k in range(20)]
    words = ["consistency", *files, "--truth", str(tmp_path / "truth.tum"), "--out", str(tmp_path), "--plot"]
    assert main(words) == 0
    assert "variance too small by" in capsys.readouterr().out
    with (tmp_path / "consistency.csv").open() as file:
        since_start, over = csv.DictReader(file)
    assert float(since_start["pose_factor_low"]) < 4.0 < float(since_start["pose_factor_high"])
    assert float(over["pose_factor_low"]) < 4.0 < float(over["pose_factor_high"])
    assert (tmp_path / "consistency.png").read_bytes().startswith(b"\x89PNG")
    assert main(["consistency", files[0], "--out", str(tmp_path)]) == 2
    assert "give one drive" in capsys.readouterr().err
