"""Join two cars' odometry by their true closures in a pose graph (docs/fleets.md); needs gtsam."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

try:
    import gtsam
except ImportError as error:
    raise SystemExit(f"{error}: pip install gtsam") from error

from recorder import TogetherResult, Trajectory, evaluate_together, read_tum, set_out_at

SECOND, POSE = 10**6, ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")


def main(fleet: Path = Path("fleet"), scores: Path = Path("scores")) -> tuple[TogetherResult, TogetherResult]:
    """Errors of two cars set out from their true starts, and joined by closures without those."""
    found = [read_tum(path) for path in sorted(scores.glob("runs/car*/*/*/*/1/estimate.tum"))]
    folders = [next((fleet / f"car{number}").glob("*/ground_truth")) for number in (1, 2)]
    truths = [read_tum(path / "lidar.tum") for path in folders]
    epoch_ns = yaml.safe_load(next(fleet.glob("car1/*/*/sequence.yaml")).read_text())["epoch_ns"]
    base_lidar = _poses(read_tum(folders[0] / "base_link.tum"))[0].between(_poses(truths[0])[0])
    ways, graph, start = [_poses(one) for one in found], gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(gtsam.PriorFactorPose3(0, ways[0][0], _noise(1e-4, 1e-3)))
    for row in csv.DictReader((fleet / "between_cars" / "closures.csv").open()):
        stamps = [int(row[f"stamp_{car}_ns"]) + epoch_ns for car in "ab"]
        a, b = (int(np.abs(one.stamp_ns - at).argmin()) for one, at in zip(found, stamps, strict=True))
        a_b = base_lidar.inverse() * _pose(np.array([float(row[name]) for name in POSE])) * base_lidar
        first_second = ways[0][a] * a_b * ways[1][b].inverse()
        graph.add(gtsam.BetweenFactorPose3(a, SECOND + b, a_b, _noise(0.01, 0.1)))
    for first, moved, way in ((0, gtsam.Pose3(), ways[0]), (SECOND, first_second, ways[1])):
        for k, T in enumerate(way):
            start.insert(first + k, moved * T)
            if k > 0:
                step = way[k - 1].between(T)
                graph.add(gtsam.BetweenFactorPose3(first + k - 1, first + k, step, _noise(1e-3, 0.02)))
    best = gtsam.LevenbergMarquardtOptimizer(graph, start).optimize()
    joined = []
    for first, one in zip((0, SECOND), found, strict=True):
        T = np.array([best.atPose3(first + k).matrix() for k in range(len(one))])
        quat = Rotation.from_matrix(T[:, :3, :3]).as_quat()
        joined.append(Trajectory(stamp_ns=one.stamp_ns, position_m=T[:, :3, 3], quat_xyzw=quat))
    known = [set_out_at(*pair) for pair in zip(truths, found, strict=True)]
    return evaluate_together(truths, known), evaluate_together(truths, joined)


def _noise(rad: float, m: float) -> Any:
    return gtsam.noiseModel.Diagonal.Sigmas(np.repeat([rad, m], 3))


def _pose(row: Any) -> Any:
    return gtsam.Pose3(gtsam.Rot3(Rotation.from_quat(row[3:]).as_matrix()), row[:3])


def _poses(one: Trajectory) -> list[Any]:
    return [_pose(row) for row in np.hstack([one.position_m, one.quat_xyzw])]


if __name__ == "__main__":
    for name, result in zip(("set out from true starts", "joined by closures"), main(), strict=True):
        print(f"{name}: {result.joint.rmse:.3f} m, between {result.between_m[0, 1].rmse:.3f} m")
