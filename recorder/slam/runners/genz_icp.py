"""GenZ-ICP (Lee et al., RA-L 2025; MIT licence), motion-compensated where points have times."""

from __future__ import annotations

from collections.abc import Iterator

from recorder.dataset.scans import ScanSource
from recorder.slam.runners.kiss_icp import RANGE_MAX_M, RANGE_MIN_M, registered
from recorder.slam.system import FrameClock, StampedPose


def run_genz_icp(sequence: ScanSource, clock: FrameClock) -> Iterator[StampedPose]:
    """Poses of the LiDAR."""
    from genz_icp.config import GenZConfig
    from genz_icp.genz_icp import GenZICP

    config = GenZConfig()
    config.data.min_range, config.data.max_range, config.data.deskew = RANGE_MIN_M, RANGE_MAX_M, True
    yield from registered(GenZICP(config), sequence, clock)
