"""KISS-ICP as `carlaloc benchmark` runs it, with one thing changed by the files beside this one."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from kiss_icp.config import KISSConfig
from kiss_icp.kiss_icp import KissICP
from numpy.typing import NDArray

from recorder import END, MIDDLE, FrameClock, SlamSequence, System

RANGE_MIN_M, RANGE_MAX_M, VOXEL_M = 2.0, 100.0, 1.0
"""Returns outside are not used [m]; voxels of the map keep their edge where the range is shorter."""

Poses = Iterator[tuple[int, NDArray[np.float64]]]


def system(name: str, title: str, *, deskewed: bool = True) -> System:
    """The variant; without correction of motion, a pose belongs to the middle of its sweep."""
    return System(
        name=name, title=title, what="KISS-ICP with one thing changed", needs=("lidar",),
        runner=f"{name}:run", frame="lidar", instant=END if deskewed else MIDDLE,
    )  # fmt: skip


def configuration() -> KISSConfig:
    """The benchmark's configuration."""
    config = KISSConfig()
    config.data.min_range, config.data.max_range, config.data.deskew = RANGE_MIN_M, RANGE_MAX_M, True
    config.mapping.voxel_size = VOXEL_M
    return config


def poses(
    sequence: SlamSequence,
    clock: FrameClock,
    config: KISSConfig,
    chosen: Callable[[Any], Any] | None = None,
    guess: Callable[[Any, Any], None] = lambda odometry, scan: None,
) -> Poses:
    """Poses of the LiDAR by the chosen points; `guess` may set the motion expected since the last sweep."""
    odometry = KissICP(config)
    for scan in sequence.scans():
        kept = scan if chosen is None else scan.take(np.asarray(chosen(scan)))
        with clock.frame():
            guess(odometry, kept)
            odometry.register_frame(kept.points_xyz_m, kept.deskew_time_s)
        yield scan.stamp_ns, np.array(odometry.last_pose)
