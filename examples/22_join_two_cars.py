"""Join two cars' odometry by their true closures in a pose graph (docs/fleets.md); needs gtsam."""

import csv
from pathlib import Path

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

try:
    import gtsam
except ImportError as error:
    raise SystemExit(f"{error}: pip install gtsam") from error

from recorder import TogetherResult, Trajectory, evaluate_together, read_tum, set_out_at

SECOND, SIGMAS, POSE = 10**6, gtsam.noiseModel.Diagonal.Sigmas, ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")
PRIOR, CLOSURE, STEP = (np.repeat(one, 3) for one in ((1e-4, 1e-3), (0.01, 0.1), (1e-3, 0.02)))


def main(fleet: Path = Path("fleet"), scores: Path = Path("scores")) -> tuple[TogetherResult, TogetherResult]:
    """Errors of two cars set out from their true starts, and joined by closures without those."""
    found = [read_tum(path) for path in sorted(scores.glob("runs/car*/*/*/*/1/estimate.tum"))]
    truths = [read_tum(next(fleet.glob(f"car{number}/*/ground_truth/lidar.tum"))) for number in (1, 2)]
    car = read_tum(next(fleet.glob("car1/*/ground_truth/base_link.tum")))
    epoch_ns = yaml.safe_load(next(fleet.glob("car1/*/*/sequence.yaml")).read_text())["epoch_ns"]
    base_lidar, ways = _poses(car)[0].between(_poses(truths[0])[0]), [_poses(one) for one in found]
    graph, start, between, joined = gtsam.NonlinearFactorGraph(), gtsam.Values(), gtsam.BetweenFactorPose3, []
    graph.add(gtsam.PriorFactorPose3(0, ways[0][0], SIGMAS(PRIOR)))
    closures = csv.DictReader((fleet / "between_cars" / "closures.csv").open())
    for row in (row for row in closures if row["car_b"] == "car2"):  # others are of units
        stamps = [int(row[f"stamp_{car}_ns"]) + epoch_ns for car in "ab"]
        a, b = (int(np.abs(one.stamp_ns - at).argmin()) for one, at in zip(found, stamps, strict=True))
        a_b = base_lidar.inverse() * _pose(np.array([float(row[name]) for name in POSE])) * base_lidar
        first_second = ways[0][a] * a_b * ways[1][b].inverse()
        graph.add(between(a, SECOND + b, a_b, SIGMAS(CLOSURE)))
    for first, moved, way in ((0, gtsam.Pose3(), ways[0]), (SECOND, first_second, ways[1])):
        for k, T in enumerate(way):
            start.insert(first + k, moved * T)
            if k > 0:
                graph.add(between(first + k - 1, first + k, way[k - 1].between(T), SIGMAS(STEP)))
    best = gtsam.LevenbergMarquardtOptimizer(graph, start).optimize()
    for first, one in zip((0, SECOND), found, strict=True):
        T = np.array([best.atPose3(first + k).matrix() for k in range(len(one))])
        quat = Rotation.from_matrix(T[:, :3, :3]).as_quat()
        joined.append(Trajectory(stamp_ns=one.stamp_ns, position_m=T[:, :3, 3], quat_xyzw=quat))
    return evaluate_together(truths, list(map(set_out_at, truths, found))), evaluate_together(truths, joined)


def _pose(row: np.ndarray) -> gtsam.Pose3:
    return gtsam.Pose3(gtsam.Rot3(Rotation.from_quat(row[3:]).as_matrix()), row[:3])


def _poses(one: Trajectory) -> list[gtsam.Pose3]:
    return [_pose(row) for row in np.hstack([one.position_m, one.quat_xyzw])]


if __name__ == "__main__":
    for name, result in zip(("set out from true starts", "joined by closures"), main(), strict=True):
        print(f"{name}: {result.joint.rmse:.3f} m, between {result.between_m[0, 1].rmse:.3f} m")
