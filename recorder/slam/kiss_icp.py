"""KISS-ICP (Vizzo et al., RA-L 2023; MIT licence) over the point clouds of a bag."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from carlaloc_env.errors import EvaluationError, MissingDependencyError
from carlaloc_env.geometry import matrix_to_quat
from recorder.evaluation.trajectory import Trajectory

Progress = Callable[[int, int], None]
"""Called with scans done and scans in all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scan:
    """One point cloud as a LiDAR odometry takes it."""

    stamp_ns: int
    """Unix time of the first point [ns]."""
    points_xyz_m: NDArray[np.float64]
    """Points in the sensor frame [m], shape (N, 3)."""
    time_s: NDArray[np.float64]
    """Time of each point after `stamp_ns` [s], shape (N,)."""


def kiss_icp_odometry(
    bag: Path,
    topic: str,
    sweep_s: float,
    *,
    range_max_m: float = 100.0,
    name: str = "KISS-ICP",
    progress: Progress | None = None,
) -> Trajectory:
    """Poses of the LiDAR that KISS-ICP estimates from a bag, motion-compensated.

    Args:
        bag: ROS 1 or ROS 2 bag.
        topic: Topic of the point clouds, fields x, y, z, time.
        sweep_s: Length of a sweep [s]; KISS-ICP gives the pose at its end.
        range_max_m: Returns beyond this are not used [m].
        name: Name of the trajectory.
        progress: Told of every scan.

    Raises:
        MissingDependencyError: KISS-ICP is not installed.
        EvaluationError: the bag has no such topic.
    """
    if find_spec("kiss_icp") is None:
        raise MissingDependencyError('KISS-ICP is not installed; pip install "carlaloc-env[slam]"')
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP

    config = KISSConfig()
    config.data.max_range = range_max_m
    config.data.min_range = 2.0
    config.data.deskew = True
    config.mapping.voxel_size = range_max_m / 100.0
    odometry = KissICP(config)
    stamps: list[int] = []
    poses: list[NDArray[np.float64]] = []
    for number, (count, scan) in enumerate(read_scans(bag, topic), start=1):
        odometry.register_frame(scan.points_xyz_m, scan.time_s)
        stamps.append(scan.stamp_ns + round(sweep_s * 1e9))
        poses.append(np.array(odometry.last_pose))
        if progress is not None:
            progress(number, count)
    if not poses:
        raise EvaluationError(f"{bag} has no point clouds on {topic}; name another topic")
    T = np.stack(poses)
    return Trajectory(
        stamp_ns=np.array(stamps, np.int64),
        position_m=T[:, :3, 3].copy(),
        quat_xyzw=matrix_to_quat(T[:, :3, :3]),
        name=name,
    )


def read_scans(bag: Path, topic: str) -> Iterator[tuple[int, Scan]]:
    """Point clouds of a topic, each with the number of all."""
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS1_NOETIC)) as reader:
        connections = [connection for connection in reader.connections if connection.topic == topic]
        count = sum(connection.msgcount for connection in connections)
        for connection, _, raw in reader.messages(connections=connections):
            message: Any = reader.deserialize(raw, connection.msgtype)
            offset = {field.name: field.offset for field in message.fields}
            data = np.asarray(message.data).reshape(-1, message.point_step)
            column = {name: _float32(data, offset[name]) for name in ("x", "y", "z", "time")}
            stamp = message.header.stamp
            yield (
                count,
                Scan(
                    stamp_ns=stamp.sec * 1_000_000_000 + stamp.nanosec,
                    points_xyz_m=np.stack([column["x"], column["y"], column["z"]], axis=-1),
                    time_s=column["time"],
                ),
            )


def _float32(data: NDArray[np.uint8], offset: int) -> NDArray[np.float64]:
    """One float32 field of all points, as float64."""
    return np.ascontiguousarray(data[:, offset : offset + 4]).view("<f4")[:, 0].astype(np.float64)
