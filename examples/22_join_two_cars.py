"""Join two cars' odometry by their true closures in a pose graph (`pip install gtsam`; docs/fleets.md)."""

import csv
from pathlib import Path

import gtsam
import numpy as np

from carlaloc_env.core.transforms import invert, matrix_to_quat, transform
from recorder.evaluation.together import TogetherResult, evaluate_together, set_out_at
from recorder.evaluation.trajectory import Trajectory
from recorder.evaluation.trajectory_files import read_tum
from recorder.writers.base import DEFAULT_EPOCH_NS

SECOND, POSE = 10**6, ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")


def main(fleet: Path = Path("fleet"), scores: Path = Path("scores")) -> tuple[TogetherResult, TogetherResult]:
    """Errors of two cars set out from their true starts, and joined by closures without those."""
    found = [read_tum(path) for path in sorted(scores.glob("runs/car*/*/*/*/1/estimate.tum"))]
    folders = [next((fleet / f"car{number}").glob("*/ground_truth")) for number in (1, 2)]
    truths = [read_tum(path / "lidar.tum") for path in folders]
    T_base_lidar = (invert(poses(read_tum(folders[0] / "base_link.tum"))) @ poses(truths[0]))[0]
    graph, start, T_first_second = gtsam.NonlinearFactorGraph(), gtsam.Values(), np.eye(4)
    graph.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(poses(found[0])[0]), noise(1e-4, 1e-3)))
    for row in csv.DictReader((fleet / "between_cars" / "closures.csv").open()):
        stamps = [int(row[f"stamp_{car}_ns"]) + DEFAULT_EPOCH_NS for car in "ab"]
        a, b = (int(np.abs(one.stamp_ns - at).argmin()) for one, at in zip(found, stamps, strict=True))
        of_bases = transform(*np.split(np.array([float(row[name]) for name in POSE]), [3]))
        T_a_b = invert(T_base_lidar) @ of_bases @ T_base_lidar
        T_first_second = poses(found[0])[a] @ T_a_b @ invert(poses(found[1])[b])
        graph.add(gtsam.BetweenFactorPose3(a, SECOND + b, gtsam.Pose3(T_a_b), noise(0.01, 0.1)))
    for first, T_world, one in ((0, np.eye(4), found[0]), (SECOND, T_first_second, found[1])):
        for k, T in enumerate(T_world @ poses(one), first):
            start.insert(k, gtsam.Pose3(T))
        for k, step in enumerate(invert(poses(one)[:-1]) @ poses(one)[1:], first):
            graph.add(gtsam.BetweenFactorPose3(k, k + 1, gtsam.Pose3(step), noise(1e-3, 0.02)))
    best = gtsam.LevenbergMarquardtOptimizer(graph, start).optimize()
    joined = [placed(one, best, first) for first, one in zip((0, SECOND), found, strict=True)]
    known = [set_out_at(*pair) for pair in zip(truths, found, strict=True)]
    return evaluate_together(truths, known), evaluate_together(truths, joined)


def noise(rad: float, m: float) -> gtsam.noiseModel.Diagonal:
    """Standard deviations of a relative pose."""
    return gtsam.noiseModel.Diagonal.Sigmas(np.repeat([rad, m], 3))


def poses(one: Trajectory) -> np.ndarray:
    """Poses as matrices."""
    return transform(one.position_m, one.quat_xyzw)


def placed(one: Trajectory, values: gtsam.Values, first: int) -> Trajectory:
    """A car's poses as the graph has them."""
    T = np.array([values.atPose3(first + k).matrix() for k in range(len(one))])
    return Trajectory(stamp_ns=one.stamp_ns, position_m=T[:, :3, 3], quat_xyzw=matrix_to_quat(T[:, :3, :3]))
