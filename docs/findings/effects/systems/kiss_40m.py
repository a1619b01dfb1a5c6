"""KISS-ICP with returns up to 40 m."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from kiss_variant import Poses, configuration, poses, system

from recorder import FrameClock, SlamSequence

SYSTEM = system("kiss_40m", "KISS-ICP, 40 m")


def run(sequence: SlamSequence, clock: FrameClock) -> Poses:
    """Poses of the LiDAR."""
    config = configuration()
    config.data.max_range = 40.0
    return poses(sequence, clock, config)
