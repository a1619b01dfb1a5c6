"""KISS-ICP without the echoes of flakes and drops: give `--clouds raw,seg`, so that clouds have labels."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import numpy as np
from kiss_variant import Poses, configuration, poses, system

from recorder import FrameClock, SlamSequence

SYSTEM = system("kiss_clear", "KISS-ICP, air removed")
OF_AIR = (0, 29)
"""Tags of drops and of flakes."""


def run(sequence: SlamSequence, clock: FrameClock) -> Poses:
    """Poses of the LiDAR."""
    return poses(sequence, clock, configuration(), chosen=lambda scan: ~np.isin(scan.tag, OF_AIR))
