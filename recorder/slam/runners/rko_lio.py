"""RKO-LIO (Malladi et al. 2025; MIT licence): LiDAR and inertial odometry."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from recorder.dataset.sequence import SlamSequence
from recorder.slam.system import FrameClock, StampedPose


def run_rko_lio(sequence: SlamSequence, clock: FrameClock) -> Iterator[StampedPose]:
    """Poses of the IMU, which is its base frame here, at the ends of the sweeps."""
    from rko_lio.config import LIOConfig
    from rko_lio.lio import LIO

    odometry = LIO(LIOConfig(initialization_phase=True, deskew=True, max_range=100.0, min_range=2.0))
    T_imu_lidar = sequence.T("imu", "lidar")
    for scan in sequence.scans():
        times_ns = scan.stamp_ns + np.rint(scan.time_s * 1e9).astype(np.int64)
        inertial = sequence.imu_until(int(times_ns.max()) + 5_000_000)
        with clock.frame():
            for sample in inertial:
                odometry.add_imu_measurement(
                    sample.acceleration_mps2, sample.angular_velocity_radps, sample.stamp_ns, np.eye(4)
                )
            odometry.register_scan(scan.points_xyz_m, times_ns, T_imu_lidar)
        yield scan.stamp_ns, np.array(odometry.pose())
