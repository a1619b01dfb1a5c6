"""KISS-ICP (Vizzo et al., RA-L 2023; MIT licence) over the point clouds of a bag."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.errors import MissingDependencyError
from recorder.evaluation.trajectory import Trajectory
from recorder.slam.scans import Progress, read_scans, trajectory_of


def kiss_icp_odometry(
    bag: Path,
    topic: str,
    sweep_s: float,
    *,
    range_max_m: float = 100.0,
    name: str = "KISS-ICP",
    progress: Progress | None = None,
) -> Trajectory:
    """Poses of the LiDAR that KISS-ICP estimates from a bag, motion-compensated.

    Args:
        bag: ROS 1 or ROS 2 bag.
        topic: Topic of the point clouds, fields x, y, z, time.
        sweep_s: Length of a sweep [s]; KISS-ICP gives the pose at its end.
        range_max_m: Returns beyond this are not used [m].
        name: Name of the trajectory.
        progress: Told of every scan.

    Raises:
        MissingDependencyError: KISS-ICP is not installed.
        EvaluationError: the bag has no such topic.
    """
    if find_spec("kiss_icp") is None:
        raise MissingDependencyError(
            'KISS-ICP is not installed; pip install "carlaloc-env[slam]" (it has no wheels for Python 3.14)'
        )
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP

    config = KISSConfig()
    config.data.max_range = range_max_m
    config.data.min_range = 2.0
    config.data.deskew = True
    config.mapping.voxel_size = range_max_m / 100.0
    odometry = KissICP(config)
    stamps: list[int] = []
    poses: list[NDArray[np.float64]] = []
    for number, (count, scan) in enumerate(read_scans(bag, topic), start=1):
        odometry.register_frame(scan.points_xyz_m, scan.time_s)
        stamps.append(scan.stamp_ns + round(sweep_s * 1e9))
        poses.append(np.array(odometry.last_pose))
        if progress is not None:
            progress(number, count)
    return trajectory_of(stamps, poses, name, bag, topic)
