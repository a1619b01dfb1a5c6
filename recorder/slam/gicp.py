"""Scan-to-map GICP by small_gicp (Koide, JOSS 2024; MIT licence) over the point clouds of a bag."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.errors import MissingDependencyError
from recorder.evaluation.trajectory import Trajectory
from recorder.slam.scans import Progress, read_scans, trajectory_of

RANGE_MIN_M, RANGE_MAX_M = 2.0, 100.0
"""Returns outside are not used [m]."""
POINT_SPACING_M, VOXEL_M = 0.25, 1.0
"""Spacing of a scan's points after thinning [m] and edge of the map's voxels [m]."""


def gicp_odometry(
    bag: Path, topic: str, sweep_s: float, *, name: str = "GICP", progress: Progress | None = None
) -> Trajectory:
    """Poses of the LiDAR by GICP against a map of Gaussian voxels, without motion compensation.

    Args:
        bag: ROS 1 or ROS 2 bag.
        topic: Topic of the point clouds, fields x, y, z, time.
        sweep_s: Length of a sweep [s]; an uncompensated scan shows its middle best.
        name: Name of the trajectory.
        progress: Told of every scan.

    Raises:
        MissingDependencyError: small_gicp is not installed.
        EvaluationError: the bag has no such topic.
    """
    if find_spec("small_gicp") is None:
        raise MissingDependencyError('small_gicp is not installed; pip install "carlaloc-env[slam]"')
    import small_gicp

    target = small_gicp.GaussianVoxelMap(VOXEL_M)
    target.set_lru(horizon=200, clear_cycle=10)
    pose, step = np.eye(4), np.eye(4)
    stamps: list[int] = []
    poses: list[NDArray[np.float64]] = []
    for number, (count, scan) in enumerate(read_scans(bag, topic), start=1):
        distance = np.linalg.norm(scan.points_xyz_m, axis=1)
        kept = scan.points_xyz_m[(distance > RANGE_MIN_M) & (distance < RANGE_MAX_M)]
        source, _ = small_gicp.preprocess_points(kept, downsampling_resolution=POINT_SPACING_M)
        if poses:
            result = small_gicp.align(target, source, init_T_target_source=pose @ step)
            fitted = np.array(result.T_target_source)
            # A rigid inverse would feed the rounding of the fit back into the next guess.
            step, pose = np.linalg.inv(pose) @ fitted, fitted
        target.insert(source, pose)
        stamps.append(scan.stamp_ns + round(0.5 * sweep_s * 1e9))
        poses.append(pose.copy())
        if progress is not None:
            progress(number, count)
    return trajectory_of(stamps, poses, name, bag, topic)
