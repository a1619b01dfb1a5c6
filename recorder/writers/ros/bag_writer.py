"""The common part of ROS 1 and ROS 2 bag writers: the message and the topic of each sample."""

from abc import abstractmethod
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
from rosbags.typesys import Stores

from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import Events, PointCloud, Sample
from carlaloc_env.sensors.lidar_config import LidarConfig
from recorder.writers.base import DEFAULT_EPOCH_NS, Encoder, Piece, Writer
from recorder.writers.driver_layouts import driver_frames
from recorder.writers.rig_calibration import BASE_FRAME, RigCalibration
from recorder.writers.ros.compact_messages import I420
from recorder.writers.ros.driver_messages import with_livox_points
from recorder.writers.ros.message_parts import Message, make_typestore
from recorder.writers.ros.messages import MessageMaker, message_type
from recorder.writers.ros.video import VideoEncoder
from recorder.writers.topic_profiles import TRUTH_TF, profile_for

_CLOCK_PERIOD_NS = 10_000_000
_VIDEO = "foxglove_msgs/msg/CompressedVideo"


class BagEncoder(Encoder):
    """Turns samples into serialised messages.

    Args:
        calibration: Where the sensors sit, and the cameras' intrinsics.
        profile: Name of a topic profile.
        streams: All streams that will come, so that a plain cloud is left out where the labelled
            cloud has the same topic; None: nothing is left out.
        epoch_ns: Unix time of the drive's beginning [ns].
        truth_tf: Whether `/tf` is written with the car's true pose.
        clock: Whether `/clock` is written.

    Raises:
        WriterError: the profile is unknown or the epoch is not positive.
    """

    store: ClassVar[Stores]
    """Version of ROS whose messages are written."""

    def __init__(
        self,
        calibration: RigCalibration,
        *,
        profile: str = "standard",
        streams: Collection[str] | None = None,
        epoch_ns: int = DEFAULT_EPOCH_NS,
        truth_tf: bool = False,
        clock: bool = False,
    ) -> None:
        self.epoch_ns = epoch_ns
        if epoch_ns <= 0:
            raise WriterError(f"epoch {epoch_ns} ns; ROS needs times after 0")
        self.calibration = calibration
        self.profile = profile_for(profile, calibration.sensors)
        if truth_tf:
            self.profile = replace(self.profile, rules=(*self.profile.rules, TRUTH_TF))
        self.clock = clock
        self._streams = streams
        self.typestore = make_typestore(self.store, self.profile.definitions)
        self._is_ros1 = self.store is Stores.ROS1_NOETIC
        self._lidars = {one.frame_id: one for one in calibration.sensors if isinstance(one, LidarConfig)}
        self.frames = {
            **calibration.frames,
            **(driver_frames(calibration.sensors) if self.profile.drivers else {}),
        }
        """For every frame of the messages, the map to `base_link`, shape (4, 4)."""
        pinholes = {camera.stream: camera.pinhole for camera in calibration.cameras}
        lenses = {camera.stream: camera.lens for camera in calibration.cameras}
        imus = {imu.name: imu for imu in (calibration.imu, *calibration.more_imus) if imu is not None}
        self.maker = MessageMaker(
            self.typestore,
            epoch_ns=epoch_ns,
            pinholes=pinholes,
            lenses=lenses,
            imus=imus,
            lidars=self._lidars,
        )

    def encode(self, sample: Sample) -> list[Piece]:
        """Messages of a sample, by their topics."""
        pieces = []
        for route in self.profile.routes(type(sample), sample.sensor, self._streams):
            # Without a topic the message is not counted: the writer counts, which sees them in order.
            message = self.maker.make(route.message, sample, "", route.frame_id)
            kind = message_type(route.message, ros1=self._is_ros1)
            data = self.serialise(message, kind)
            if isinstance(sample, Events):
                data = self._with_events(data, sample)
            elif isinstance(sample, PointCloud) and route.message.startswith("livox"):
                lidar = self._lidars[sample.frame_id]
                data = with_livox_points(data, lidar, sample, is_cdr=not self._is_ros1)
            pieces.append(Piece(sample.stamp_ns, route.topic, kind, data))
        return pieces

    @abstractmethod
    def serialise(self, message: Message, kind: str) -> bytes:
        """A message of a type, e.g. ``sensor_msgs/msg/Imu``, as it stands in the bag."""

    @abstractmethod
    def deserialise(self, data: bytes, kind: str) -> Message:
        """The message of what `serialise` has made."""

    @abstractmethod
    def _with_events(self, empty: bytes, sample: Events) -> bytes:
        """A serialised message without events, and with those of a sample."""


class BagWriter(Writer):
    """Puts messages into a bag; a topic appears when its first message does."""

    encoder: BagEncoder

    def __init__(self, target: str | Path, encoder: BagEncoder) -> None:
        super().__init__(target, encoder)
        cameras = encoder.calibration.cameras
        self._video_hz = max((camera.rate_hz for camera in cameras), default=20.0)
        self._videos: dict[str, VideoEncoder] = {}
        self._clock_due_ns: int | None = None

    def _place(self, piece: Piece) -> None:
        if self._clock_due_ns is None:
            self._write_tf_static(piece.stamp_ns)
            self._clock_due_ns = piece.stamp_ns
        if self.encoder.clock and piece.stamp_ns >= self._clock_due_ns:
            self._clock_due_ns = piece.stamp_ns + _CLOCK_PERIOD_NS
            kind = "rosgraph_msgs/msg/Clock"
            clock = self.encoder.serialise(self.encoder.maker.clock(piece.stamp_ns), kind)
            self._add(Piece(piece.stamp_ns, "/clock", kind, clock))
        self._add(self._with_video(piece) if piece.kind == _VIDEO else piece)

    def _with_video(self, piece: Piece) -> Piece:
        """A picture as video: each depends on earlier pictures, so that the writer encodes them in order."""
        message = self.encoder.deserialise(piece.data, piece.kind)
        kind, width, height = message.format.split()
        assert kind == I420
        if piece.place not in self._videos:
            self._videos[piece.place] = VideoEncoder(int(width), int(height), self._video_hz)
        data = self._videos[piece.place].encode(bytes(message.data))
        message.data, message.format = np.frombuffer(data, np.uint8), "h264"
        return Piece(piece.stamp_ns, piece.place, piece.kind, self.encoder.serialise(message, piece.kind))

    def _write_tf_static(self, stamp_ns: int) -> None:
        frames = self.encoder.frames
        if self.encoder.profile.tf_static and frames:
            kind = "tf2_msgs/msg/TFMessage"
            message = self.encoder.maker.tf_static(BASE_FRAME, frames, stamp_ns)
            self._add(
                Piece(stamp_ns, "/tf_static", kind, self.encoder.serialise(message, kind)), latched=True
            )

    @abstractmethod
    def _add(self, piece: Piece, *, latched: bool = False) -> None:
        """Append a message.

        Args:
            piece: Its topic, type, time since the drive began, and bytes.
            latched: Whether later subscribers get it too.
        """
