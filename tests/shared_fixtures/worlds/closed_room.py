"""A LiDAR without a flaw that drives straight through a closed room, where odometry does not drift, as a bag.

How far a pose lies ahead of the place where its sweep began, over the speed, is the instant of that pose.
"""

from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from carlaloc_env.core.array_types import Array
from recorder.evaluation.trajectory import Trajectory

TOPIC = "/lidar/points"
SWEEP_S, SWEEPS = 0.05, 60
SPEED_MPS, GENTLE_MPS2 = 4.0, 3.0
ROOM_M = np.array([[-12.0, 20.0], [-6.0, 9.0], [-1.8, 4.0]])
"""Walls, floor and ceiling."""
EPOCH_S = 100.0
REST_S = 0.5


def place_m(time_s: Array) -> Array:
    """How far the LiDAR has come: half a second of rest, then up to its speed."""
    driven_s = np.maximum(time_s - REST_S, 0.0)
    ramp_s = SPEED_MPS / GENTLE_MPS2
    on_ramp: Array = 0.5 * GENTLE_MPS2 * driven_s**2
    return np.where(driven_s < ramp_s, on_ramp, SPEED_MPS * (driven_s - 0.5 * ramp_s))


def sweep(begins_s: float, elevations_deg: Array) -> Array:
    """Points of one sweep in the moving sensor's frame, and their times after its beginning: (N, 4)."""
    columns, elevations = np.arange(720), np.radians(elevations_deg)
    after_s = np.repeat(columns / len(columns) * SWEEP_S, len(elevations))
    azimuth = -2.0 * np.pi * after_s / SWEEP_S
    elevation = np.tile(elevations, len(columns))
    ray = np.stack(
        [np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)], axis=1
    )
    origin = np.zeros_like(ray)
    origin[:, 0] = place_m(begins_s + after_s)
    wall = np.where(ray > 0.0, ROOM_M[:, 1], ROOM_M[:, 0])
    distance_m = ((wall - origin) / np.where(ray == 0.0, 1e-12, ray)).min(axis=1)
    return np.column_stack([ray * distance_m[:, None], after_s])


def write_room_bag(path: Path, elevations_deg: Array) -> None:
    """A ROS 1 bag of the sweeps."""
    store = get_typestore(Stores.ROS1_NOETIC)
    kinds = store.types
    field, header = kinds["sensor_msgs/msg/PointField"], kinds["std_msgs/msg/Header"]
    fields = [field(name=name, offset=4 * k, datatype=7, count=1) for k, name in enumerate("xyz")]
    fields.append(field(name="time", offset=12, datatype=7, count=1))
    with Writer(path) as writer:
        cloud = "sensor_msgs/msg/PointCloud2"
        connection = writer.add_connection(TOPIC, cloud, typestore=store)
        for k in range(SWEEPS):
            data = sweep(k * SWEEP_S, elevations_deg).astype("<f4")
            stamp_ns = round((EPOCH_S + k * SWEEP_S) * 1e9)
            time = kinds["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
            message = kinds[cloud](
                header=header(seq=k, stamp=time, frame_id="lidar"), height=1, width=len(data),
                fields=fields, is_bigendian=False, point_step=16, row_step=16 * len(data),
                data=data.reshape(-1).view(np.uint8), is_dense=True,
            )  # fmt: skip
            writer.write(connection, stamp_ns, store.serialize_ros1(message, cloud))


def late_s(estimate: Trajectory) -> float:
    """Median time between the stamps of poses at constant speed and when the LiDAR was in their place [s]."""
    stamp_s = estimate.stamp_ns * 1e-9 - EPOCH_S
    steady = stamp_s > REST_S + SPEED_MPS / GENTLE_MPS2 + 0.2
    assert steady.sum() > 15
    ahead_m = estimate.position_m[steady, 0] - estimate.position_m[0, 0] - place_m(stamp_s[steady])
    return float(np.median(ahead_m) / SPEED_MPS)
