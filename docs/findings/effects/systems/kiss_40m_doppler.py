"""KISS-ICP with returns up to 40 m, whose expected motion is the velocity that the points measured."""

import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from kiss_variant import Poses, configuration, poses, system

from recorder import FrameClock, SlamSequence

SYSTEM = system("kiss_40m_doppler", "KISS-ICP, 40 m, velocities")
PERIOD_S, ROUNDS, AGREES_MPS = 0.1, 10, 0.1


def expect(odometry: Any, scan: Any) -> None:
    """Move by the velocity of points at rest, whose rates are −u·v; turn as between the last two sweeps."""
    near = np.linalg.norm(scan.points_xyz_m, axis=1)
    used = near < 40.0
    along, rates = scan.points_xyz_m[used] / near[used, None], scan.doppler_mps[used]
    weight, velocity = np.ones(len(along)), np.zeros(3)
    for _ in range(ROUNDS):
        velocity = np.linalg.lstsq(along * weight[:, None], -rates * weight, rcond=None)[0]
        weight = 1.0 / (1.0 + ((rates + along @ velocity) / AGREES_MPS) ** 2)
    odometry.last_delta[:3, 3] = velocity * PERIOD_S


def run(sequence: SlamSequence, clock: FrameClock) -> Poses:
    """Poses of the LiDAR."""
    config = configuration()
    config.data.max_range = 40.0
    return poses(sequence, clock, config, guess=expect)
