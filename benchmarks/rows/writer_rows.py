"""Bag writers: bytes a second into memory, and the paper's LiDAR beside a conversion point by point."""

import itertools
import struct
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import zstandard
from bench import Bench, Row, compared
from timing import time_calls

from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.samples import Image, PointCloud, Sample
from recorder.writers.base import Piece, Writer
from recorder.writers.rig_calibration import RigCalibration
from recorder.writers.ros.rosbag1 import Ros1Encoder, Rosbag1Writer
from recorder.writers.ros.rosbag2 import Ros2Encoder, Rosbag2Writer

_MEMORY = Path("/dev/shm")
_POINTS = 60_000
_RIG = RigCalibration.from_configs(rig_by_name("paper").sensors)


def _instant() -> list[Sample]:
    """A stereo pair and a cloud, noise included."""
    rng = np.random.default_rng(0)
    ramp = np.linspace(0, 200, 1280, dtype=np.float32)[None, :, None]
    pair: list[Sample] = [
        Image(
            sensor=f"rgb_{side}",
            frame_id=f"camera_{side}",
            stamp_ns=0,
            rgb=(ramp + rng.integers(0, 12, (720, 1280, 3))).astype(np.uint8),
        )
        for side in ("left", "right")
    ]
    return [*pair, _cloud()]


def _cloud() -> PointCloud:
    rng = np.random.default_rng(1)
    return PointCloud(
        sensor="lidar",
        frame_id="lidar",
        stamp_ns=0,
        points_xyz_m=rng.normal(0, 20, (_POINTS, 3)).astype(np.float32),
        intensity=rng.uniform(0, 255, _POINTS).astype(np.float32),
        ring=(np.arange(_POINTS) % 32).astype(np.uint16),
        offset_ns=(np.arange(_POINTS) // 32 * 24_000).astype(np.uint32),
        sweep_ns=STEP_NS,
    )


def bag_rate(
    name: str, make: Callable[[Path], Writer], beside: str, alone: Callable[[bytes], object], least: float
) -> Callable[[Bench], Row]:
    """A row of how fast a writer puts messages into a file in memory, beside its heaviest call alone.

    A rate of its own would be that of the machine: packing is most of the work.
    """

    def row(bench: Bench) -> Row:
        with tempfile.TemporaryDirectory(dir=_MEMORY if _MEMORY.is_dir() else None) as folder:
            writer = make(Path(folder) / "bag")
            pieces = [piece for sample in _instant() for piece in writer.encoder.encode(sample)]
            size = sum(len(piece.data) for piece in pieces)
            stamps = itertools.count(0, STEP_NS)

            def place() -> None:
                stamp = next(stamps)
                for piece in pieces:
                    writer.place(Piece(stamp, piece.place, piece.kind, piece.data))

            writer.open()
            calls: dict[str, Callable[[], object]] = {
                "ours": place,
                "alone": lambda: [alone(piece.data) for piece in pieces],
            }
            times = time_calls(calls, (2 if bench.quick else 10) * bench.repeat)
            writer.abort()
        return Row(
            name=name,
            what=f"{name}: a stereo pair and a cloud, {size / 1e6:.1f} MB, into memory",
            value=times["alone"].cpu_s / times["ours"].cpu_s,
            unit=f"of {beside}'s speed",
            target=least,
            ours=times["ours"],
            note=f"{size / 1e6 / times['ours'].cpu_s:.0f} MB/s of CPU time",
        )

    return row


def lidar_bag(bench: Bench) -> Row:
    """A cloud as a message of a ROS 1 bag, beside the usual loop over its points."""
    cloud = _cloud()
    encoder = Ros1Encoder(_RIG, profile="paper", streams={"lidar"})
    calls: dict[str, Callable[[], object]] = {
        "ours": partial(encoder.encode, cloud),
        "naive": partial(_by_points, cloud),
    }
    times = time_calls(calls, bench.repeat)
    what = f"cloud of {_POINTS} points as PointCloud2, ROS 1"
    return compared("lidar_bag", what, times, 10.0, "against struct.pack for each point")


def _by_points(cloud: PointCloud) -> bytes:
    data = bytearray()
    for k in range(len(cloud.points_xyz_m)):
        x, y, z = cloud.points_xyz_m[k]
        data += struct.pack(
            "<ffffHf", x, y, z, cloud.intensity[k], cloud.ring[k], float(cloud.offset_ns[k]) * 1e-9
        )
    return bytes(data)


rosbag1_rate = bag_rate(
    "rosbag1",
    lambda path: Rosbag1Writer(path.with_suffix(".bag"), Ros1Encoder(_RIG)),
    "a copy",
    bytearray,
    0.08,
)
mcap_rate = bag_rate(
    "mcap", lambda path: Rosbag2Writer(path, Ros2Encoder(_RIG)), "zstd", zstandard.compress, 0.6
)
