"""What systems read: the protocol, the sensors of a rig, topics of bags.

Sensor data as systems read them, and the protocol of their sources: a folder's files, or a drive.

The sensors of a rig that SLAM systems read: the first of each kind.

Bags: their topics and messages, and the topic of a stream under a profile.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import U8, Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import Sample
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.imu import ImuConfig
from carlaloc_env.sensors.ranging_config import LidarConfig
from recorder.bags import open_bag, refused_in_one_line
from recorder.writers.topics import TopicProfile

if TYPE_CHECKING:
    from recorder.dataset.scans import Scan


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuSample:
    """An inertial sample."""

    stamp_ns: int
    """Unix time [ns]."""
    acceleration_mps2: Array
    """Specific force in the IMU's axes [m/s²], shape (3,)."""
    angular_velocity_radps: Array
    """Rate of turning in the IMU's axes [rad/s], shape (3,)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoPair:
    """Two grey images of the same instant."""

    stamp_ns: int
    """Unix time [ns]."""
    left: U8
    """Left image, shape (H, W)."""
    right: U8
    """Right image, shape (H, W)."""
    left_mover: NDArray[np.bool_] | None = None
    """Where movers of the left image are painted over; None: nowhere. Shape (H, W)."""


class Readings(Protocol):
    """Sensor data of a sequence in the order of time.

    All methods raise `EvaluationError` where the sequence lacks the requested data.
    """

    @property
    def bag(self) -> Path:
        """A bag of it, of any format."""

    @property
    def euroc(self) -> Path:
        """A folder ``mav0`` of it."""

    def scan_count(self) -> int:
        """Number of sweeps."""

    def scans(self) -> Iterator[Scan]:
        """All sweeps, labelled where there are labels."""

    def imu_samples(self) -> Iterator[ImuSample]:
        """All inertial samples."""

    def image_stamps(self) -> NDArray[np.int64]:
        """Unix times of the images of the left camera [ns], shape (N,)."""

    def stereo_pairs(self, *, without_movers: bool) -> Iterator[StereoPair]:
        """All pairs of grey images, on request with movers painted over."""


def lidar_of(rig: SensorRig) -> LidarConfig:
    """The LiDAR.

    Raises:
        EvaluationError: the rig has none.
    """
    return cast(LidarConfig, _first(rig, "lidar"))


def imu_of(rig: SensorRig) -> ImuConfig:
    """The IMU.

    Raises:
        EvaluationError: the rig has none.
    """
    return cast(ImuConfig, _first(rig, "imu"))


def stereo_of(rig: SensorRig) -> tuple[CameraConfig, CameraConfig]:
    """The first two cameras, the left one first.

    Raises:
        EvaluationError: the rig has fewer.
    """
    cameras = cast(tuple[CameraConfig, ...], rig.of_kind("camera"))
    if len(cameras) < 2:
        raise EvaluationError(f"rig '{rig.name}' has {len(cameras)} cameras; stereo needs two")
    return cameras[0], cameras[1]


def first_camera_of(rig: SensorRig) -> CameraConfig:
    """The first camera.

    Raises:
        EvaluationError: the rig has none.
    """
    return cast(CameraConfig, _first(rig, "camera"))


def _first(rig: SensorRig, kind: str) -> Any:
    found = rig.of_kind(kind)
    if not found:
        raise EvaluationError(f"rig '{rig.name}' has no {kind}; replay with a rig that has one")
    return found[0]


__all__ = ["messages", "open_bag", "stamp_ns", "topic_of", "topics_in"]


def topics_in(bag: Path) -> dict[str, int]:
    """Number of messages by topic.

    Raises:
        EvaluationError: the bag is missing or damaged.
    """
    with open_bag(bag) as reader:
        counts: dict[str, int] = {}
        for connection in reader.connections:
            counts[connection.topic] = counts.get(connection.topic, 0) + connection.msgcount
        return counts


def messages(bag: Path, topic: str) -> Iterator[Any]:
    """All messages of a topic.

    Raises:
        EvaluationError: the bag is missing or damaged.
    """
    with open_bag(bag) as reader:
        wanted = [connection for connection in reader.connections if connection.topic == topic]
        # Without any the reader would give all messages.
        if not wanted:
            return
        with refused_in_one_line(bag):
            for connection, _, raw in reader.messages(connections=wanted):
                yield reader.deserialize(raw, connection.msgtype)


def stamp_ns(message: Any) -> int:
    """Time in a message's header [ns]."""
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def topic_of(
    profile: TopicProfile,
    kind: type[Sample],
    wanted: Sequence[str],
    *,
    streams: Collection[str],
    encoders: Collection[str],
) -> str | None:
    """Topic of the first wanted stream that a profile writes by a known encoder; None: it has none.

    Args:
        profile: Topics of the bag.
        kind: Kind of sample.
        wanted: Names of streams, the best one first.
        streams: All streams of the sequence.
        encoders: Names of those of `messages.ENCODERS` whose messages the reader understands.
    """
    for stream in wanted:
        for route in profile.routes(kind, stream, streams) if stream in streams else ():
            if route.message in encoders:
                return route.topic
    return None
