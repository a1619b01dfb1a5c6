"""Scan-to-map GICP by small_gicp (Koide, JOSS 2024; MIT licence), without motion compensation."""

from __future__ import annotations

import numpy as np

from recorder.dataset.scans import ScanSource
from recorder.slam.system import FrameClock, StampedPose

RANGE_MIN_M, RANGE_MAX_M = 2.0, 100.0
"""Returns outside are not used [m]."""
POINT_SPACING_M, VOXEL_M = 0.25, 1.0
"""Spacing of a scan's points after thinning [m] and edge of the map's voxels [m]."""


def run(sequence: ScanSource, clock: FrameClock) -> list[StampedPose]:
    """Poses of the LiDAR."""
    import small_gicp

    target = small_gicp.GaussianVoxelMap(VOXEL_M)
    target.set_lru(horizon=200, clear_cycle=10)
    pose, step = np.eye(4), np.eye(4)
    poses: list[StampedPose] = []
    for scan in sequence.scans():
        distance = np.linalg.norm(scan.points_xyz_m, axis=1)
        kept = scan.points_xyz_m[(distance > RANGE_MIN_M) & (distance < RANGE_MAX_M)]
        with clock.frame():
            source, _ = small_gicp.preprocess_points(kept, downsampling_resolution=POINT_SPACING_M)
            if poses:
                result = small_gicp.align(target, source, init_T_target_source=pose @ step)
                fitted = np.array(result.T_target_source)
                # A rigid inverse would feed the rounding of the fit back into the next guess.
                step, pose = np.linalg.inv(pose) @ fitted, fitted
            target.insert(source, pose)
        poses.append((scan.stamp_ns, pose.copy()))
    return poses
