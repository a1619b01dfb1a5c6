"""LiDAR odometry by libraries: KISS-ICP, GenZ-ICP, RKO-LIO, small_gicp."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from carlaloc_env.core.array_types import Array
from recorder.dataset.scans import ScanSource
from recorder.dataset.sequence import SlamSequence
from recorder.evaluation.se3 import composed_covariance
from recorder.slam.system import FrameClock, StampedPose

RANGE_MIN_M, RANGE_MAX_M = 2.0, 100.0
"""Returns outside are not used [m]; the voxels of KISS-ICP's map are a hundredth of the larger."""
POINT_SPACING_M, VOXEL_M = 0.25, 1.0
"""small_gicp's spacing of a scan's points after thinning [m] and edge of the map's voxels [m]."""


def near_m(sequence: ScanSource) -> float:
    """Distance from which returns of a sequence are not of the car itself [m]; of a stranger's, the usual."""
    return sequence.lidar.near_m if isinstance(sequence, SlamSequence) else RANGE_MIN_M


def run_kiss_icp(sequence: ScanSource, clock: FrameClock) -> Iterator[StampedPose]:
    """Poses of the LiDAR by KISS-ICP (Vizzo et al., RA-L 2023; MIT licence), motion-compensated."""
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP

    config = KISSConfig()
    config.data.min_range, config.data.max_range, config.data.deskew = near_m(sequence), RANGE_MAX_M, True
    config.mapping.voxel_size = RANGE_MAX_M / 100.0
    yield from registered(KissICP(config), sequence, clock)


def registered(odometry: Any, sequence: ScanSource, clock: FrameClock) -> Iterator[StampedPose]:
    """Poses of KISS-ICP, or of a system with its interface."""
    for scan in sequence.scans():
        with clock.frame():
            odometry.register_frame(scan.points_xyz_m, scan.deskew_time_s)
        yield scan.stamp_ns, np.array(odometry.last_pose)


def run_genz_icp(sequence: ScanSource, clock: FrameClock) -> Iterator[StampedPose]:
    """Poses of the LiDAR by GenZ-ICP (Lee et al., RA-L 2025; MIT licence), motion-compensated."""
    from genz_icp.config import GenZConfig
    from genz_icp.genz_icp import GenZICP

    config = GenZConfig()
    config.data.min_range, config.data.max_range, config.data.deskew = near_m(sequence), RANGE_MAX_M, True
    yield from registered(GenZICP(config), sequence, clock)


def run_rko_lio(sequence: SlamSequence, clock: FrameClock) -> Iterator[StampedPose]:
    """Poses of the IMU by RKO-LIO (Malladi et al. 2025; MIT licence), at the ends of the sweeps."""
    from rko_lio.config import LIOConfig
    from rko_lio.lio import LIO

    near = near_m(sequence)
    odometry = LIO(LIOConfig(initialization_phase=True, deskew=True, max_range=RANGE_MAX_M, min_range=near))
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


def run_small_gicp(sequence: ScanSource, clock: FrameClock) -> Iterator[StampedPose]:
    """Poses of the LiDAR by small_gicp (Koide, JOSS 2024; MIT licence), scan to map, without compensation.

    Each fit counts as an independent measurement of the motion since the last sweep; see `fit_covariance`.
    """
    import small_gicp

    target = small_gicp.GaussianVoxelMap(VOXEL_M)
    target.set_lru(horizon=200, clear_cycle=10)
    near = near_m(sequence)
    pose, step, covariance = np.eye(4), np.eye(4), np.zeros((6, 6))
    is_first = True
    for scan in sequence.scans():
        distance = np.linalg.norm(scan.points_xyz_m, axis=1)
        kept = scan.points_xyz_m[(distance > near) & (distance < RANGE_MAX_M)]
        with clock.frame():
            source, _ = small_gicp.preprocess_points(kept, downsampling_resolution=POINT_SPACING_M)
            if not is_first:
                result = small_gicp.align(target, source, init_T_target_source=pose @ step)
                fitted = np.array(result.T_target_source)
                # A rigid inverse would feed the rounding of the fit back into the next guess.
                step, pose = np.linalg.inv(pose) @ fitted, fitted
                covariance = composed_covariance(covariance, step, fit_covariance(result))
            target.insert(source, pose)
        is_first = False
        clock.covariances[scan.stamp_ns] = covariance
        yield scan.stamp_ns, pose.copy()


def fit_covariance(result: Any) -> Array:
    """Covariance of a fit, (6, 6), translation first: H⁻¹ · 2 error / (3 pairs − 6), in the sweep's own axes.

    small_gicp's Hessian is that of T · exp(rotation, translation); its error is half the sum of squares.

    Args:
        result: `small_gicp.RegistrationResult`.
    """
    order = np.array([3, 4, 5, 0, 1, 2])
    H = np.array(result.H)[order[:, None], order]
    variance = 2.0 * float(result.error) / max(3 * int(result.num_inliers) - 6, 1)
    covariance: Array = np.linalg.inv(H) * variance
    return covariance
