"""What systems read: the protocol, the sensors of a rig, topics of bags.

Sensor data as systems read them, and the protocol of their sources: a folder's files, or a drive.

The sensors of a rig that SLAM systems read: the first of each kind.

Bags: their topics and messages, and the topic of a stream under a profile.

Faults of stamps and of inertial values.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import U8, Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import Sample
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.imu import ImuConfig
from carlaloc_env.sensors.ranging_config import LidarConfig
from recorder.bags import open_bag, refused_in_one_line
from recorder.evaluation.trajectory import Trajectory
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


Stamps: TypeAlias = NDArray[np.int64]


def stamps_in(bag: Path) -> dict[tuple[str, str], Stamps]:
    """Times of all messages [ns], by topic and type.

    Raises:
        EvaluationError: the bag is missing or damaged.
    """
    found: dict[tuple[str, str], list[int]] = defaultdict(list)
    with open_bag(bag) as reader, refused_in_one_line(bag):
        for connection, stamp, _ in reader.messages():
            found[connection.topic, connection.msgtype].append(stamp)
    return {key: np.array(stamps, np.int64) for key, stamps in found.items()}


def check_gaps(name: str, stamps_ns: Stamps) -> Iterator[str]:
    """Gaps between messages, and stamps that do not rise."""
    steps = np.diff(stamps_ns)
    if len(steps) < 2:
        return
    period = int(np.median(steps))
    if period <= 0 or steps.min() <= 0:
        yield f"{name}: stamps do not rise"
        return
    wide = np.flatnonzero(steps > 1.5 * period)
    if len(wide):
        first = stamps_ns[wide[0]]
        yield f"{name} has {len(wide)} gaps, the first of {steps[wide[0]] / 1e9:.3f} s after {first} ns"


WINDOW_S = 0.5
"""Time over which the IMU is integrated [s]."""
FORCE_MPS2, RATE_RADPS = 0.3, 0.02
"""Largest mean error of acceleration [m/s²] and angular rate [rad/s]; biases are smaller."""
_G_MPS2, _IMU_MAX = 9.81, 4000
"""Gravity, and messages of a foreign IMU that are looked at."""


def imu_sample(message: Any) -> ImuSample:
    """An inertial message's stamp and values."""
    a, w = message.linear_acceleration, message.angular_velocity
    return ImuSample(
        stamp_ns=stamp_ns(message),
        acceleration_mps2=np.array([a.x, a.y, a.z]),
        angular_velocity_radps=np.array([w.x, w.y, w.z]),
    )


def imu_faults(samples: Iterable[ImuSample], T_base_imu: Array, truth: Trajectory) -> Iterator[str]:
    """Faults of an IMU's values, which are integrated beside the true motion.

    Args:
        samples: All samples.
        T_base_imu: Maps coordinates of the IMU to those of the truth's body, shape (4, 4).
        truth: Motion of that body.
    """
    samples = list(samples)
    stamps = np.array([sample.stamp_ns for sample in samples], np.int64)
    if np.any(np.diff(stamps) <= 0):
        yield "IMU: stamps do not rise"
        return
    if len(samples) < 20:
        return
    base = truth.at(stamps)
    imu = base.of_sensor(T_base_imu)
    force = transforms.quat_rotate(imu.quat_xyzw, np.array([one.acceleration_mps2 for one in samples]))
    rate = np.array([T_base_imu[:3, :3] @ one.angular_velocity_radps for one in samples])
    period_s = float(np.median(np.diff(stamps))) / 1e9
    step = max(2, round(WINDOW_S / period_s))
    velocity = np.gradient(imu.position_m, period_s, axis=0)
    turns = transforms.quat_multiply(transforms.quat_conjugate(base.quat_xyzw[:-1]), base.quat_xyzw[1:])
    true_rate = 2.0 * turns[:, :3] * np.sign(turns[:, 3:4]) / period_s
    force_error, rate_error = [], []
    for begin in range(1, len(samples) - step - 1, step):
        window = slice(begin, begin + step)
        change = (velocity[begin + step] - velocity[begin]) / (step * period_s)
        kinematic = force[window].mean(axis=0) - [0.0, 0.0, _G_MPS2]
        force_error.append(float(np.linalg.norm(kinematic - change)))
        rate_error.append(float(np.linalg.norm((rate[window] - true_rate[window]).mean(axis=0))))
    if force_error and (off := np.median(force_error)) > FORCE_MPS2:
        cause = f" ({why})" if (why := gravity_fault(force)) else ""
        yield f"IMU does not fit the truth: accelerations are {off:.2f} m/s² off{cause}"
    if rate_error and (off := np.median(rate_error)) > RATE_RADPS:
        yield f"IMU does not fit the truth: angular rates are {off:.3f} rad/s off"


def gravity_fault(force_mps2: Array) -> str | None:
    """Which unit or sign is wrong with specific forces in axes of which z points up, shape (N, 3)."""
    mean = force_mps2.mean(axis=0)
    size = float(np.linalg.norm(mean))
    if 0.8 < size < 1.2:
        return "they are in g, not in m/s²"
    if size < 0.5:
        return "they lack gravity"
    if mean[2] < -0.8 * _G_MPS2:
        return "gravity has the wrong sign: at rest, an axis that points up measures +9.81 m/s²"
    return None


def faults_of_foreign(bag: Path) -> Iterator[str]:
    """Faults of the inertial messages at the beginning of any bag: stamps, unit and sign of gravity.

    Raises:
        EvaluationError: the bag is missing or damaged.
    """
    with open_bag(bag) as reader:
        topics = {c.topic for c in reader.connections if c.msgtype == "sensor_msgs/msg/Imu" and c.msgcount}
    for topic in sorted(topics):
        found = [imu_sample(message) for message in islice(messages(bag, topic), _IMU_MAX)]
        yield from check_gaps(topic, np.array([sample.stamp_ns for sample in found], np.int64))
        if why := gravity_fault(np.array([sample.acceleration_mps2 for sample in found])):
            yield f"accelerations of {topic} look wrong, if its z axis points up: {why}"


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
