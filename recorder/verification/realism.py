"""Compares recordings with real ones by metrics of their clouds, pictures and inertial readings.

The metrics need no truth: any bag will do, of this project or another, and any folder of pictures.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import ConfigError, EvaluationError, unknown_name
from recorder.bags.reader import open_bag, refused_in_one_line
from recorder.dataset.bag_messages import imu_sample, stamp_ns
from recorder.dataset.clouds import CLOUD, read_cloud
from recorder.dataset.lidar_topics import cloud_connections, of_one_frame
from recorder.dataset.point_times import time_rule
from recorder.dataset.scans import Scan, scans_of
from recorder.verification.imu_metrics import ImuLog, imu_metrics
from recorder.verification.lidar_metrics import is_like_hdl32e, lidar_metrics, means_of, sweeps_of
from recorder.verification.picture_metrics import REAL_PICTURES, picture_metrics
from recorder.verification.real_ranges import (
    COMMA_SOURCE,
    KITTI_SOURCE,
    LIDAR_SOURCE,
    PICTURE_SOURCE,
    REAL_IMU,
    REAL_LIDAR,
)

_LOOKED_AT, _RULE_CLOUDS = 6, 10
"""Sweeps and pictures that are looked at, evenly over a bag, and clouds that show the rule of times."""
_PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
_LABELS = ("depth", "semantic", "instance", "label", "mask", "segment")
"""Parts of topics' names whose images are no pictures."""
_ENCODINGS: dict[str, tuple[int, int | None]] = {
    "mono8": (1, None), "8UC1": (1, None), "rgb8": (3, cv2.COLOR_RGB2GRAY), "bgr8": (3, cv2.COLOR_BGR2GRAY),
    "8UC3": (3, cv2.COLOR_BGR2GRAY), "rgba8": (4, cv2.COLOR_RGBA2GRAY), "bgra8": (4, cv2.COLOR_BGRA2GRAY),
}  # fmt: skip
"""Channels of an image by its encoding, and OpenCV's conversion to grey."""
_SPEEDS = ("geometry_msgs/msg/TwistStamped", "nav_msgs/msg/Odometry", "sensor_msgs/msg/NavSatFix")
"""Messages that show the car's speed, the best one first."""
_DEGREE_M = 40_007_863.0 / 360.0
"""A degree of a meridian [m]."""
_BASE_S = 0.5
"""Positions so long before and after show a speed [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RealismMetric:
    """A metric of a recording beside the range of real ones."""

    group: str
    """``lidar``, ``pictures`` or ``imu``."""
    name: str
    value: float
    low: float | None
    """Least real value; None: the metric depends on the scene alone."""
    high: float | None
    """Largest real value."""
    source: str
    """Real recordings that gave the range."""

    @property
    def verdict(self) -> str:
        """``inside``, ``OUTSIDE``, or empty where there is no range or no value."""
        if self.low is None or self.high is None or math.isnan(self.value):
            return ""
        return "inside" if self.low <= self.value <= self.high else "OUTSIDE"


@dataclass(frozen=True, slots=True, kw_only=True)
class Realism:
    """Metrics of a recording."""

    path: Path
    """The bag, or the folder of pictures."""
    read: dict[str, str]
    """Topic or files that each group was read from."""
    metrics: tuple[RealismMetric, ...]
    """All metrics that could be measured."""


def measure_realism(
    path: Path, *, lidar: str | None = None, camera: str | None = None, imu: str | None = None
) -> Realism:
    """Metrics of a bag's first LiDAR, camera and IMU, or of the pictures of a folder.

    Args:
        path: A bag as `open_bag` takes it, or a folder of pictures.
        lidar: Topic of the clouds; None: the one that looks like a LiDAR's.
        camera: Topic of the pictures; None: the first by name.
        imu: Topic of the inertial readings; None: the first by name.

    Raises:
        EvaluationError: there is nothing to measure, or it is damaged.
        ConfigError: there is no such topic.
    """
    if path.is_dir() and (files := sorted(p for p in path.iterdir() if p.suffix.lower() in _PICTURES)):
        pictures = [
            _decoded(np.fromfile(file, np.uint8), str(file))
            for file in files[:: max(len(files) // _LOOKED_AT, 1)]
        ]
        read = {"pictures": f"{len(pictures)} of {len(files)} files"}
        return Realism(path=path, read=read, metrics=_of_pictures(pictures))
    with open_bag(path) as reader, refused_in_one_line(path):
        return _of_bag(path, reader, lidar, camera, imu)


def _of_bag(path: Path, reader: AnyReader, lidar: str | None, camera: str | None, imu: str | None) -> Realism:
    has_clouds = any(CLOUD.fullmatch(c.msgtype) and c.msgcount for c in reader.connections)
    images = _topic(reader, ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"), camera, _LABELS)
    readings = _topic(reader, ("sensor_msgs/msg/Imu",), imu)
    parts = {
        "lidar": (lambda: _of_clouds(path, reader, lidar)) if has_clouds or lidar else None,
        "pictures": (lambda: _of_images(reader, images)) if images else None,
        "imu": (lambda: _of_readings(reader, readings)) if readings else None,
    }
    read: dict[str, str] = {}
    metrics: list[RealismMetric] = []
    failed: list[EvaluationError] = []
    for group, measure in parts.items():
        if measure is not None:
            try:
                read[group], measured = measure()
                metrics += measured
            except EvaluationError as error:
                # A topic that was asked for has to do; others may lack what the metrics need.
                if (group == "lidar" and lidar is not None) or (group == "imu" and imu is not None):
                    raise
                read[group] = str(error)
                failed.append(error)
    if not metrics and failed:
        raise failed[0]
    if not read:
        raise EvaluationError(f"{path} holds no clouds, no pictures and no IMU; give a bag that has some")
    return Realism(path=path, read=read, metrics=tuple(metrics))


def _of_clouds(path: Path, reader: AnyReader, topic: str | None) -> tuple[str, tuple[RealismMetric, ...]]:
    chosen, scans = _scans(path, reader, topic)
    elevation_deg = next(sweeps_of(scans)).elevation_deg
    read, alike = f"{chosen[0].topic}, {len(scans)} sweeps", is_like_hdl32e(elevation_deg)
    metrics = _metrics("lidar", lidar_metrics(scans), REAL_LIDAR if alike else {}, LIDAR_SOURCE)
    if not alike:
        low, high = elevation_deg.min(), elevation_deg.max()
        read += f"; {len(elevation_deg)} rings, {low:.0f} to {high:.0f} deg: the real ranges are an HDL-32E's"
    return read, metrics


def _of_images(reader: AnyReader, images: list[Connection]) -> tuple[str, tuple[RealismMetric, ...]]:
    pictures = [_picture(reader, c, raw) for c, _, raw in _evenly(reader, images)]
    return f"{images[0].topic}, {len(pictures)} pictures", _of_pictures(pictures)


def _of_pictures(pictures: Sequence[NDArray[np.uint8]]) -> tuple[RealismMetric, ...]:
    means = means_of([picture_metrics(picture) for picture in pictures])
    return _metrics("pictures", means, REAL_PICTURES, PICTURE_SOURCE)


def _of_readings(reader: AnyReader, readings: list[Connection]) -> tuple[str, tuple[RealismMetric, ...]]:
    values = imu_metrics(_log(reader, readings))
    rows: tuple[RealismMetric, ...] = ()
    for at, source in (("4-8", KITTI_SOURCE), ("16-20", COMMA_SOURCE), ("rest", KITTI_SOURCE)):
        part = {name: value for name, value in values.items() if f" at {at}" in name}
        rows += _metrics("imu", part, REAL_IMU, source)
    return readings[0].topic, rows


def _metrics(
    group: str, values: dict[str, float], real: dict[str, tuple[float, float]], source: str
) -> tuple[RealismMetric, ...]:
    return tuple(
        RealismMetric(
            group=group, name=name, value=value, low=low, high=high, source=source if low is not None else ""
        )
        for name, value in values.items()
        for low, high in [real.get(name, (None, None))]
    )


def _topic(
    reader: AnyReader, kinds: tuple[str, ...], wanted: str | None, refused: tuple[str, ...] = ()
) -> list[Connection]:
    """Connections of the wanted topic, or of the first one by name that has messages of these kinds."""
    fitting: dict[str, list[Connection]] = {}
    for connection in reader.connections:
        if connection.msgtype in kinds and connection.msgcount:
            fitting.setdefault(connection.topic, []).append(connection)
    if wanted is not None:
        if wanted not in fitting:
            what = kinds[0].rpartition("/")[2]
            raise ConfigError(unknown_name(f"topic of {what} messages", wanted, sorted(fitting)))
        return fitting[wanted]
    usual = (topic for topic in sorted(fitting) if not any(part in topic.lower() for part in refused))
    return fitting.get(next(usual, ""), [])


def _evenly(reader: AnyReader, connections: list[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
    """About `_LOOKED_AT` messages of a topic, evenly over its time; only they are read."""
    count = sum(connection.msgcount for connection in connections)
    first = [at for _, at, _ in itertools.islice(reader.messages(connections), 20)]
    if not first:
        return
    every = max(count // _LOOKED_AT, 1)
    period_ns = (first[-1] - first[0]) // max(len(first) - 1, 1)
    for number in range(0, count, every):
        after = first[0] + number * period_ns - period_ns // 2
        message = next(iter(reader.messages(connections, start=after)), None)
        if message is not None:
            yield message


def _scans(path: Path, reader: AnyReader, topic: str | None) -> tuple[list[Connection], list[Scan]]:
    connections, frame = cloud_connections(path, reader, topic)
    first = [
        read_cloud(reader, c, raw)
        for c, _, raw in itertools.islice(reader.messages(connections), _RULE_CLOUDS)
    ]
    where = f"{path}: {connections[0].topic}"
    rule = time_rule(first, where)
    clouds = ((at, read_cloud(reader, c, raw, rule.field)) for c, at, raw in _evenly(reader, connections))
    return connections, list(scans_of(of_one_frame(clouds, where, frame), where, rule))


def _decoded(data: NDArray[np.uint8], what: str) -> NDArray[np.uint8]:
    """Grey values of a file's content (H, W)."""
    image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if len(data) else None
    if image is None:
        raise EvaluationError(f"{what} is no picture, or a damaged one; give PNG or JPEG")
    return np.asarray(image, np.uint8)


def _picture(reader: AnyReader, connection: Connection, raw: bytes) -> NDArray[np.uint8]:
    """Grey values of a message's picture (H, W)."""
    message: Any = reader.deserialize(raw, connection.msgtype)
    if not hasattr(message, "encoding"):
        return _decoded(np.asarray(message.data, np.uint8), f"an image on {connection.topic}")
    if message.encoding not in _ENCODINGS:
        encodings = ", ".join(_ENCODINGS)
        raise EvaluationError(
            f"{connection.topic} has images of {message.encoding}, not of {encodings}; --camera names another"
        )
    channels, code = _ENCODINGS[message.encoding]
    rows = np.asarray(message.data, np.uint8).reshape(message.height, message.step)
    image = rows[:, : message.width * channels].reshape(message.height, message.width, channels)
    return image[..., 0] if code is None else np.asarray(cv2.cvtColor(image, code), np.uint8)


def _log(reader: AnyReader, connections: list[Connection]) -> ImuLog:
    samples = [imu_sample(reader.deserialize(raw, c.msgtype)) for c, _, raw in reader.messages(connections)]
    stamps = np.array([sample.stamp_ns for sample in samples], np.int64)
    order = np.argsort(stamps, kind="stable")
    at_ns, speed = _speeds(reader)
    speed_mps = (
        np.interp(stamps[order], at_ns, speed, left=math.nan, right=math.nan) if len(at_ns) else math.nan
    )
    return ImuLog(
        stamp_ns=stamps[order],
        force_mps2=np.array([sample.acceleration_mps2 for sample in samples])[order],
        rate_radps=np.array([sample.angular_velocity_radps for sample in samples])[order],
        speed_mps=np.broadcast_to(speed_mps, stamps.shape),
    )


def _speeds(reader: AnyReader) -> tuple[NDArray[np.int64], Array]:
    """Times [ns] and speeds of the car [m/s] by the best topic that shows them; empty: none does."""
    chosen: list[Connection] = next(
        (connections for kind in _SPEEDS if (connections := _topic(reader, (kind,), None))), []
    )
    raws = reader.messages(chosen) if chosen else ()
    messages: list[Any] = [reader.deserialize(raw, connection.msgtype) for connection, _, raw in raws]
    at_ns = np.array([stamp_ns(message) for message in messages], np.int64)
    if len(at_ns) < 2:
        return at_ns[:0], np.zeros(0)
    if chosen[0].msgtype == _SPEEDS[0]:
        return at_ns, np.array([math.hypot(m.twist.linear.x, m.twist.linear.y) for m in messages])
    place = np.array([_place(message) for message in messages])
    base_ns = round(_BASE_S * 1e9)
    ends = [[np.interp(at_ns + side * base_ns, at_ns, axis) for axis in place.T] for side in (-1, 1)]
    inside = (at_ns - base_ns >= at_ns[0]) & (at_ns + base_ns <= at_ns[-1])
    way = np.hypot(*(np.array(ends[1]) - np.array(ends[0])))
    return at_ns[inside], way[inside] / (2 * _BASE_S)


def _place(message: Any) -> tuple[float, float]:
    """East and north [m]; of degrees, up to a constant."""
    if hasattr(message, "latitude"):
        east_m = _DEGREE_M * math.cos(math.radians(message.latitude)) * message.longitude
        return east_m, _DEGREE_M * message.latitude
    position = message.pose.pose.position
    return position.x, position.y
