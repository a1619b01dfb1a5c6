"""GenZ-ICP (Lee et al., RA-L 2025; MIT licence), motion-compensated where points have times."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from recorder.dataset.scans import ScanSource
from recorder.slam.system import FrameClock, StampedPose

RANGE_MIN_M, RANGE_MAX_M = 2.0, 100.0
"""Returns outside are not used [m]."""


def run(sequence: ScanSource, clock: FrameClock) -> Iterator[StampedPose]:
    """Poses of the LiDAR."""
    from genz_icp.config import GenZConfig
    from genz_icp.genz_icp import GenZICP

    config = GenZConfig()
    config.data.min_range, config.data.max_range, config.data.deskew = RANGE_MIN_M, RANGE_MAX_M, True
    odometry = GenZICP(config)
    for scan in sequence.scans():
        with clock.frame():
            odometry.register_frame(scan.points_xyz_m, scan.deskew_time_s)
        yield scan.stamp_ns, np.array(odometry.last_pose)
