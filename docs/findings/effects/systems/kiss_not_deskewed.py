"""KISS-ICP without correction of motion."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from kiss_variant import Poses, configuration, poses, system

from recorder import FrameClock, SlamSequence

SYSTEM = system("kiss_not_deskewed", "KISS-ICP, not deskewed", deskewed=False)


def run(sequence: SlamSequence, clock: FrameClock) -> Poses:
    """Poses of the LiDAR."""
    config = configuration()
    config.data.deskew = False
    return poses(sequence, clock, config)
