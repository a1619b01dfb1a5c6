"""small_gicp's covariance: what its Hessian means, and two seeds of noise on one drive."""

import json
import runpy
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from shared_fixtures.drives.straight_drives import StraightDrive

from carlaloc_env.core.array_types import Array
from recorder.cli.main import main
from recorder.slam.runners.lidar_odometry import fit_covariance

small_gicp = pytest.importorskip("small_gicp")


def corner(random: np.random.Generator, noise_m: float, count: int) -> Array:
    """Points on three walls of a room's corner."""
    flat = random.uniform(0.5, 9.5, (3, count, 2))
    walls = [np.insert(points, axis, 0.0, axis=1) for axis, points in enumerate(flat)]
    return np.concatenate(walls) + noise_m * random.normal(size=(3 * count, 3))


def test_its_hessian_is_that_of_a_turn_and_a_shift_in_the_sweeps_own_axes() -> None:
    """Against differences of the error by T · exp(rotation, translation); so b is the gradient."""
    random = np.random.default_rng(0)
    target, tree = small_gicp.preprocess_points(corner(random, 0.01, 900), downsampling_resolution=0.1)
    source, _ = small_gicp.preprocess_points(corner(random, 0.01, 200), downsampling_resolution=0.1)
    T = np.eye(4)
    T[:3, 3] = [0.03, -0.02, 0.01]
    factor = small_gicp.GICPFactor()

    def of(pose: Array, index: int) -> tuple[Array, float]:
        _, _, b, error = factor.linearize(target, source, tree, pose, index, small_gicp.DistanceRejector())
        return np.ravel(b), error

    def moved(axis: int, by: float) -> Array:
        xi = np.zeros(6)
        xi[axis] = by
        a, b, c, x, y, z = xi
        return T @ expm(np.array([[0, -c, b, x], [c, 0, -a, y], [-b, a, 0, z], [0, 0, 0, 0]]))

    for index in (0, 50, 100):
        ends = [(of(moved(k, 1e-6), index)[1], of(moved(k, -1e-6), index)[1]) for k in range(6)]
        slope = np.array([(after - before) / 2e-6 for after, before in ends])
        b = of(T, index)[0]
        assert b[3:] == pytest.approx(slope[3:], rel=1e-4, abs=1e-6)
        # Where points' own ellipsoids turn with the sweep, b leaves that out.
        assert b[:3] == pytest.approx(slope[:3], rel=0.2, abs=0.05 * np.abs(slope).max())


def test_the_covariance_of_a_fit_shrinks_with_points_and_grows_with_noise() -> None:
    """Least squares: the variance is that of a residual over the number of pairs."""
    random = np.random.default_rng(1)

    def trace(noise_m: float, count: int) -> float:
        clouds = [corner(random, noise_m, count) for _ in range(2)]
        ready = [small_gicp.preprocess_points(cloud, downsampling_resolution=1e-3) for cloud in clouds]
        (target, tree), (source, _) = ready
        covariance = fit_covariance(small_gicp.align(target, source, tree))
        assert np.linalg.eigvalsh(covariance).min() > 0
        return float(np.trace(covariance[:3, :3]))

    assert trace(0.02, 3200) / trace(0.02, 800) == pytest.approx(0.25, rel=0.3)
    assert trace(0.04, 1600) / trace(0.02, 1600) == pytest.approx(4.0, rel=0.3)


def test_two_seeds_of_one_drive_share_its_truth_and_not_their_noise(
    straight_drive: StraightDrive, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By the example, then by the command on the same runs. The car stands: no error over a distance."""
    example = Path(__file__).parents[2] / "examples" / "robustness" / "17_honest_covariance.py"
    town = straight_drive.town
    result = runpy.run_path(str(example))["main"](
        straight_drive.episode, tmp_path, "small_gicp", 2, duration_s=0.5, map=town
    )
    (row,) = result.rows()
    assert "variance of the position too small by" in capsys.readouterr().out
    assert (row["error"], row["runs"], row["failed"]) == ("since the start", 2, 0)
    assert 0.0 < row["scatter_along"] < 0.02
    assert row["pose_anees"] > 0.0
    first, second = sorted(tmp_path.rglob("ground_truth/lidar.tum"))
    assert first.read_bytes() == second.read_bytes()
    one, other = sorted(tmp_path.rglob("estimate.cov"))
    assert one.read_bytes() != other.read_bytes()
    made_ns = one.stat().st_mtime_ns
    words = ["consistency", str(straight_drive.episode), "--map", str(town), "--rig", "lidar"]
    words += ["--methods", "small_gicp", "--duration", "0.5", "--out", str(tmp_path)]
    assert main([*words, "--seeds", "2", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rows"][0]["pose_anees"] == row["pose_anees"]
    assert one.stat().st_mtime_ns == made_ns
    assert main([*words, "--seeds", "1"]) == 1
    assert "two seeds or more" in capsys.readouterr().err
