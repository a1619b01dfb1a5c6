"""KISS-ICP (Vizzo et al., RA-L 2023; MIT licence), motion-compensated where points have times."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from recorder.dataset.scans import ScanSource
from recorder.slam.system import FrameClock, StampedPose

RANGE_MIN_M, RANGE_MAX_M = 2.0, 100.0
"""Returns outside are not used [m]; the voxels of its map are a hundredth of the larger."""


def run_kiss_icp(sequence: ScanSource, clock: FrameClock) -> Iterator[StampedPose]:
    """Poses of the LiDAR."""
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP

    config = KISSConfig()
    config.data.min_range, config.data.max_range, config.data.deskew = RANGE_MIN_M, RANGE_MAX_M, True
    config.mapping.voxel_size = RANGE_MAX_M / 100.0
    yield from registered(KissICP(config), sequence, clock)


def registered(odometry: Any, sequence: ScanSource, clock: FrameClock) -> Iterator[StampedPose]:
    """Poses of KISS-ICP, or of a system with its interface."""
    for scan in sequence.scans():
        with clock.frame():
            odometry.register_frame(scan.points_xyz_m, scan.deskew_time_s)
        yield scan.stamp_ns, np.array(odometry.last_pose)
