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
from recorder.bags.reader import open_bag
from recorder.dataset.bag_messages import imu_sample, topic_of
from recorder.dataset.clouds import cloud_of_draco, cloud_of_fields
from recorder.dataset.layout import DriveFolder
from recorder.dataset.reading_checks import imu_faults
from recorder.evaluation.trajectory import Trajectory
from recorder.evaluation.trajectory_files import read_tum
from recorder.writers.calibration.files import EXTRINSICS
from recorder.writers.ros.compact_messages import depth_of_png
from recorder.writers.topics import TopicProfile

FRAMES = 5
"""Depth images that are compared."""
WITHIN_M, WITHIN_SHARE = 0.1, 0.02
"""A point fits if its depth differs by no more than this [m] and this share of it."""
FITTING_SHARE = 0.6
"""Least share of fitting points; the others lie at outlines, which two sensors see differently."""
_CLOUDS = ("points_labelled", "points", "cloud_draco")
_DEPTHS = ("image_32fc1", "depth_png")
"""Encoders of messages that are compared, see `messages.ENCODERS`."""


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
            raws = (raw for _, _, raw in reader.messages([imu]))
            samples = (imu_sample(reader.deserialize(raw, imu.msgtype)) for raw in raws)
            yield from imu_faults(samples, T_base["imu"], truth)


def _check_depth(
    reader: Any,
    depths: Connection,
    lidar: Connection,
    camera_info: Connection,
    T_base: Mapping[str, Array],
    truth: Trajectory,
) -> Iterator[str]:
    _, _, first = next(reader.messages([camera_info]))
    info = reader.deserialize(first, camera_info.msgtype)
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
            is_fitting = _fitting(points, _depth_of(image), info)
            fitting, total = fitting + int(is_fitting.sum()), total + len(is_fitting)
    if total >= 100 and fitting < FITTING_SHARE * total:
        share = f"{100 * fitting / total:.0f} % of {total} points"
        yield f"LiDAR does not fit {depths.topic}: {share} have its depth"


def _depth_of(image: Any) -> Any:
    """Planar depth [m] of a plain or a compressed image, 0 where there is none, shape (H, W)."""
    if hasattr(image, "format"):
        return depth_of_png(image.data.tobytes())
    plain = image.data.view("<f4").reshape(image.height, image.width)
    return np.nan_to_num(plain, posinf=0.0)


def _points_of(cloud: Any) -> tuple[Array, Any]:
    """Points [m] of a plain or a Draco cloud, (N, 3), and their times after the stamp [ns], (N,)."""
    points = cloud_of_draco(cloud) if hasattr(cloud, "format") else cloud_of_fields(cloud)
    after_ns = np.round(points.times["time"].astype(float) * 1e9).astype(np.int64)
    return points.points_xyz_m, after_ns


def _in_camera(
    xyz: Array, after_ns: Any, stamp_ns: int, T_base_lidar: Array, T_base_camera: Array, truth: Trajectory
) -> Array:
    """Points of a cloud, each measured at another time, in the camera's frame at the stamp, shape (N, 3)."""
    at_ns = stamp_ns + after_ns
    keep = at_ns <= truth.stamp_ns[-1]
    times_ns, row = np.unique(at_ns[keep], return_inverse=True)
    swept, still = truth.at(times_ns), truth.at(np.array([stamp_ns]))
    in_base = transforms.apply(T_base_lidar, xyz[keep])
    world = transforms.quat_rotate(swept.quat_xyzw[row], in_base) + swept.position_m[row]
    T_world_base = transforms.from_rotation(
        transforms.quat_to_matrix(still.quat_xyzw[0]), still.position_m[0]
    )
    return transforms.apply(np.linalg.inv(T_world_base @ T_base_camera), world)


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
