"""Calibration against data: LiDAR points in depth images, and the IMU integrated beside the truth."""

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from rosbags.interfaces import Connection

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.samples import DepthImage, Image, Imu, PointCloud, Sample
from recorder.dataset.clouds import cloud_of_draco, cloud_of_fields
from recorder.dataset.layout import DriveFolder
from recorder.dataset.readings import open_bag, topic_of
from recorder.evaluation.trajectory import Trajectory
from recorder.evaluation.trajectory_files import read_tum
from recorder.writers.calibration.files import EXTRINSICS
from recorder.writers.ros.sensor_messages import depth_of_png
from recorder.writers.topics import TopicProfile

FRAMES = 5
"""Depth images that are compared."""
WITHIN_M, WITHIN_SHARE = 0.1, 0.02
"""A point fits if its depth differs by no more than this [m] and this share of it."""
FITTING_SHARE = 0.6
"""Least share of fitting points; the others lie at outlines, which two sensors see differently."""
WINDOW_S = 0.5
"""Time over which the IMU is integrated [s]."""
FORCE_MPS2, RATE_RADPS = 0.3, 0.02
"""Largest mean error of acceleration [m/s²] and angular rate [rad/s]; biases are smaller."""
_CLOUDS = ("points_labelled", "points", "cloud_draco")
_DEPTHS = ("image_32fc1", "depth_png")
"""Encoders of messages that are compared, see `messages.ENCODERS`."""
_GRAVITY_MPS2 = np.array([0.0, 0.0, -9.81])


def extrinsics_of(drive: DriveFolder) -> dict[str, Array]:
    """Maps each sensor frame's coordinates to `base_link`, by frame, from the calibration that is shipped."""
    document = yaml.safe_load((drive.calibration / EXTRINSICS).read_text("utf-8"))
    frames: dict[str, Any] = document["frames"]
    return {name: np.array(entry[f"T_base_link_{name}"], float) for name, entry in frames.items()}


def check_fit(
    drive: DriveFolder, bag: Path, profile: TopicProfile, streams: Collection[str]
) -> Iterator[str]:
    """Parts of the calibration that do not fit a bag.

    Args:
        drive: Folder of calibration and truth.
        bag: The bag.
        profile: Its topics.
        streams: Streams of the sequence.
    """
    T_base = extrinsics_of(drive)
    truth = read_tum(drive.truth("base_link"))

    def topic(kind: type[Sample], encoders: tuple[str, ...], *wanted: str) -> str | None:
        return topic_of(profile, kind, wanted, streams=streams, encoders=encoders)

    with open_bag(bag) as reader:
        connections: dict[str | None, Connection] = {c.topic: c for c in reader.connections}
        lidar = connections.get(topic(PointCloud, _CLOUDS, "lidar_semantic", "lidar"))
        for stream in sorted(streams):
            depths = connections.get(topic(DepthImage, _DEPTHS, stream))
            info = connections.get(topic(Image, ("camera_info",), stream.replace("depth_", "rgb_")))
            if depths and lidar and info and "lidar" in T_base:
                yield from _check_depth(reader, depths, lidar, info, T_base, truth)
        imu = connections.get(topic(Imu, ("imu",), "imu"))
        if imu and "imu" in T_base:
            yield from _check_imu(reader, imu, T_base["imu"], truth)


def _check_depth(
    reader: Any,
    depths: Connection,
    lidar: Connection,
    camera_info: Connection,
    T_base: Mapping[str, Array],
    truth: Trajectory,
) -> Iterator[str]:
    info = _first(reader, camera_info)
    stamps = [stamp for _, stamp, _ in reader.messages([depths])]
    chosen = set(stamps[:: max(1, len(stamps) // FRAMES)])
    clouds = {stamp: raw for _, stamp, raw in reader.messages([lidar]) if stamp in chosen}
    fitting, total = 0, 0
    for connection, stamp, raw in reader.messages([depths]):
        if stamp in clouds:
            image = reader.deserialize(raw, connection.msgtype)
            xyz, after_ns = _points_of(reader.deserialize(clouds[stamp], lidar.msgtype))
            T_base_camera = T_base[image.header.frame_id]
            points = _in_camera(xyz, after_ns, stamp, T_base["lidar"], T_base_camera, truth)
            found = _fitting(points, _depth_of(image), info)
            fitting, total = fitting + int(found.sum()), total + len(found)
    if total >= 100 and fitting < FITTING_SHARE * total:
        share = f"{100 * fitting / total:.0f} % of {total} points"
        yield f"LiDAR does not fit {depths.topic}: {share} have its depth"


def _depth_of(image: Any) -> Any:
    """Planar depth [m] of a plain or a compressed image, 0 where there is none, shape (H, W)."""
    if hasattr(image, "format"):
        return depth_of_png(image.data.tobytes())
    return image.data.view("<f4").reshape(image.height, image.width)


def _points_of(cloud: Any) -> tuple[Array, Any]:
    """Points [m] of a plain or a Draco cloud, (N, 3), and their times after the stamp [ns], (N,)."""
    found = cloud_of_draco(cloud) if hasattr(cloud, "format") else cloud_of_fields(cloud)
    after_ns = np.round(found.times["time"].astype(float) * 1e9).astype(np.int64)
    return found.points_xyz_m, after_ns


def _in_camera(
    xyz: Array, after_ns: Any, stamp_ns: int, T_base_lidar: Array, T_base_camera: Array, truth: Trajectory
) -> Array:
    """Points of a cloud, each measured at another time, in the camera's frame at the stamp, shape (N, 3)."""
    at_ns = stamp_ns + after_ns
    keep = at_ns <= truth.stamp_ns[-1]
    position, quat = _pose_at(truth, at_ns[keep])
    world = transforms.quat_rotate(quat, transforms.apply(T_base_lidar, xyz[keep])) + position
    position, quat = _pose_at(truth, np.array([stamp_ns]))
    T_world_base = np.eye(4)
    T_world_base[:3, :3], T_world_base[:3, 3] = transforms.quat_to_matrix(quat[0]), position[0]
    return transforms.apply(np.linalg.inv(T_world_base @ T_base_camera), world)


def _pose_at(truth: Trajectory, stamp_ns: Any) -> tuple[Array, Array]:
    after = np.clip(np.searchsorted(truth.stamp_ns, stamp_ns, side="right"), 1, len(truth.stamp_ns) - 1)
    before = after - 1
    fraction = (stamp_ns - truth.stamp_ns[before]) / (truth.stamp_ns[after] - truth.stamp_ns[before])
    start, end = truth.position_m[before], truth.position_m[after]
    position = start + fraction[:, None] * (end - start)
    return position, transforms.quat_slerp(truth.quat_xyzw[before], truth.quat_xyzw[after], fraction)


def _fitting(points: Array, depth_m: Any, info: Any) -> Any:
    """Whether each point in view has the depth of its pixel."""
    points = points[points[:, 2] > 1.0]
    points = points[(np.abs(points[:, :2]) < 2.0 * points[:, 2:3]).all(axis=1)]
    if not len(points):
        return np.zeros(0, bool)
    K = np.array(info.K if hasattr(info, "K") else info.k).reshape(3, 3)
    D = np.array(info.D if hasattr(info, "D") else info.d)
    zero = np.zeros(3)
    if info.distortion_model == "equidistant":
        pixels, _ = cv2.fisheye.projectPoints(points[:, None], zero, zero, K, D[:4])
    else:
        pixels, _ = cv2.projectPoints(points[:, None], zero, zero, K, D)
    u, v = np.round(pixels[:, 0]).astype(int).T
    seen = (u >= 0) & (v >= 0) & (u < depth_m.shape[1]) & (v < depth_m.shape[0])
    z = points[seen, 2]
    # On a street seen at a flat angle, a pixel spans metres: its neighbours bound the depths.
    sky_far = np.where(depth_m > 0.0, depth_m, np.float32(1e6))
    around = np.ones((3, 3), np.uint8)
    nearest, farthest = (
        cv2.erode(sky_far, around)[v[seen], u[seen]],
        cv2.dilate(depth_m, around)[v[seen], u[seen]],
    )
    margin = WITHIN_M + WITHIN_SHARE * z
    return (z > nearest - margin) & (z < farthest + margin)


def _check_imu(reader: Any, connection: Connection, T_base_imu: Array, truth: Trajectory) -> Iterator[str]:
    rows = []
    for _, stamp, raw in reader.messages([connection]):
        m = reader.deserialize(raw, connection.msgtype)
        f, w = m.linear_acceleration, m.angular_velocity
        rows.append((stamp, f.x, f.y, f.z, w.x, w.y, w.z))
    if len(rows) < 20:
        return
    stamps = np.array([row[0] for row in rows], np.int64)
    values = np.array([row[1:] for row in rows])
    position, quat = _pose_at(truth, stamps)
    lever = transforms.quat_rotate(quat, T_base_imu[:3, 3]) + position
    turned = transforms.apply(transforms.from_rotation(T_base_imu[:3, :3]), values[:, :3])
    acceleration = transforms.quat_rotate(quat, turned) + _GRAVITY_MPS2
    rate = transforms.apply(transforms.from_rotation(T_base_imu[:3, :3]), values[:, 3:])
    period_s = float(np.median(np.diff(stamps))) / 1e9
    step = max(2, round(WINDOW_S / period_s))
    velocity = np.gradient(lever, period_s, axis=0)
    turns = transforms.quat_multiply(transforms.quat_conjugate(quat[:-1]), quat[1:])
    true_rate = 2.0 * turns[:, :3] * np.sign(turns[:, 3:4]) / period_s
    force_error, rate_error = [], []
    for begin in range(1, len(stamps) - step - 1, step):
        window = slice(begin, begin + step)
        change = (velocity[begin + step] - velocity[begin]) / (step * period_s)
        force_error.append(float(np.linalg.norm(acceleration[window].mean(axis=0) - change)))
        rate_error.append(float(np.linalg.norm((rate[window] - true_rate[window]).mean(axis=0))))
    if force_error and np.median(force_error) > FORCE_MPS2:
        yield f"IMU does not fit the truth: accelerations are {np.median(force_error):.2f} m/s² off"
    if rate_error and np.median(rate_error) > RATE_RADPS:
        yield f"IMU does not fit the truth: angular rates are {np.median(rate_error):.3f} rad/s off"


def _first(reader: Any, connection: Connection) -> Any:
    _, _, raw = next(reader.messages([connection]))
    return reader.deserialize(raw, connection.msgtype)
