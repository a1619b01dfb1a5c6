"""Open3D's ICP by planes, as beside this file, without velocities of points."""

import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
import icp_40m_doppler

from recorder import MIDDLE, FrameClock, SlamSequence, System

SYSTEM = System(
    name="icp_40m", title="ICP by planes, 40 m", what="ICP by planes", needs=("lidar",),
    runner="icp_40m:run", frame="lidar", instant=MIDDLE,
)  # fmt: skip


def run(sequence: SlamSequence, clock: FrameClock) -> Any:
    """Poses of the LiDAR."""
    return icp_40m_doppler.run(sequence, clock, weight=0.0)
