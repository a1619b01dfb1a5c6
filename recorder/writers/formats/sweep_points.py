"""Points of a LiDAR's sweep, moved to one instant as perception datasets want them."""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.samples import PointCloud
from recorder.writers.base import Piece
from recorder.writers.formats.ego_path import EgoPath
from recorder.writers.formats.nuscenes_boxes import ActorTracks

POINT = np.dtype(
    [("xyz", "<f4", 3), ("intensity", "<f4"), ("ring", "<f4"), ("offset_ns", "<u4"), ("tag", "u1"),
     ("instance", "<u4")]
)  # fmt: skip
"""A point before it is moved to its sweep's stamp."""


def point_rows(sample: PointCloud) -> bytes:
    """Points of a sweep as rows of the layout `POINT`."""
    rows = np.zeros(len(sample.ring), POINT)
    rows["xyz"], rows["intensity"], rows["ring"] = sample.points_xyz_m, sample.intensity, sample.ring
    rows["offset_ns"] = sample.offset_ns
    if sample.tag is not None and sample.instance is not None:
        rows["tag"], rows["instance"] = sample.tag, sample.instance
    return rows.tobytes()


def at_stamp(
    piece: Piece, rows: NDArray[np.void], path: EgoPath, tracks: ActorTracks, T_base_lidar: Array
) -> Array:
    """Points of a sweep in the world [m] (N, 3), moved with their road users to the stamp of the sweep.

    Args:
        piece: The sweep.
        rows: Its points, of the layout `POINT`.
        path: Where the car was.
        tracks: Where the road users were.
        T_base_lidar: Place of the LiDAR on the car.
    """
    seen_ns = piece.stamp_ns + rows["offset_ns"].astype(np.int64)
    world = path.to_world(rows["xyz"].astype(np.float64), seen_ns, T_base_lidar)
    return tracks.brought_to(piece.stamp_ns, world, seen_ns, rows["instance"])
