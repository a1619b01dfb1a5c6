"""KISS-ICP on every second ring."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from kiss_variant import Poses, configuration, poses, system

from recorder import FrameClock, SlamSequence

SYSTEM = system("kiss_half", "KISS-ICP, every second ring")


def run(sequence: SlamSequence, clock: FrameClock) -> Poses:
    """Poses of the LiDAR."""
    return poses(sequence, clock, configuration(), chosen=lambda scan: scan.ring % 2 == 0)
