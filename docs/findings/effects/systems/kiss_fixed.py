"""KISS-ICP with a fixed threshold of 2 m."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from kiss_variant import Poses, configuration, poses, system

from recorder import FrameClock, SlamSequence

SYSTEM = system("kiss_fixed", "KISS-ICP, fixed threshold")


def run(sequence: SlamSequence, clock: FrameClock) -> Poses:
    """Poses of the LiDAR."""
    config = configuration()
    config.adaptive_threshold.fixed_threshold = 2.0
    return poses(sequence, clock, config)
