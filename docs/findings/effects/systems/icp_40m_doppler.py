"""Doppler-ICP (Hexsel et al., RSS 2022) in Open3D, sweep to sweep, with returns up to 40 m.

Its cost adds the velocities of points to the distances to planes; without them it is an ICP by planes.
Numbers are those of the authors' demonstration.
"""

from typing import Any

import numpy as np
import open3d
from open3d.t.pipelines import registration

from recorder import MIDDLE, FrameClock, SlamSequence, System

RANGE_MAX_M, VOXEL_M, PERIOD_S, REACH_M, NORMAL_RADIUS_M = 40.0, 0.3, 0.1, 0.3, 10.0
DOPPLER_WEIGHT, DYNAMIC_MPS = 0.01, 2.0
"""Share of velocities in the cost; points that move faster than this are left out [m/s]."""

SYSTEM = System(
    name="icp_40m_doppler", title="Doppler-ICP, 40 m", what="ICP by planes and velocities", needs=("lidar",),
    runner="icp_40m_doppler:run", frame="lidar", instant=MIDDLE,
)  # fmt: skip


def cloud(scan: Any) -> Any:
    """A sweep as Open3D's cloud: positions, directions, rates of range, normals."""
    distance = np.linalg.norm(scan.points_xyz_m, axis=1)
    used = (distance > 2.0) & (distance < RANGE_MAX_M)
    found = open3d.t.geometry.PointCloud(scan.points_xyz_m[used].astype(np.float64))
    found.point.dopplers = -scan.doppler_mps[used, None].astype(np.float64)  # Open3D: approaching positive
    found.point.directions = (scan.points_xyz_m[used] / distance[used, None]).astype(np.float64)
    found = found.voxel_down_sample(VOXEL_M)
    found.estimate_normals(max_nn=30, radius=NORMAL_RADIUS_M)
    return found


def run(sequence: SlamSequence, clock: FrameClock, weight: float = DOPPLER_WEIGHT) -> Any:
    """Poses of the LiDAR."""
    tensor: Any = open3d.core.Tensor
    kernel = registration.robust_kernel.RobustKernel
    tukey = registration.robust_kernel.RobustKernelMethod.TukeyLoss
    estimation = registration.TransformationEstimationForDopplerICP(
        PERIOD_S, weight, weight > 0, DYNAMIC_MPS, 2, 0, 2, kernel(tukey, 0.5, 1.0), kernel(tukey, 0.2, 1.0),
        tensor(np.eye(4)),
    )  # fmt: skip
    criteria = registration.ICPConvergenceCriteria(1e-6, 1e-6, 50)
    pose, step, last = np.eye(4), np.eye(4), None
    for scan in sequence.scans():
        with clock.frame():
            now = cloud(scan)
            if last is not None:
                start = tensor(step)
                found = registration.icp(now, last, REACH_M, start, estimation, criteria)
                step = found.transformation.numpy()
                pose = pose @ step
            last = now
        yield scan.stamp_ns, pose.copy()
