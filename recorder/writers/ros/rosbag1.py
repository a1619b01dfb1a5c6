"""ROS 1 bags, written without ROS."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import lz4.frame  # type: ignore[import-untyped]
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Writer as BagFile
from rosbags.typesys import Stores

from carlaloc_env.core.errors import WriterError, unknown_name
from carlaloc_env.samples import Events, Sample
from recorder.writers.base import DEFAULT_EPOCH_NS, Writer
from recorder.writers.rig_calibration import BASE_FRAME, RigCalibration
from recorder.writers.ros.event_messages import ros1_with_events
from recorder.writers.ros.message_parts import make_typestore
from recorder.writers.ros.messages import ENCODERS, MessageMaker
from recorder.writers.topics import profile_by_name

COMPRESSIONS = ("none", "lz4", "bz2")
"""Ways to compress a bag's chunks."""
_CLOCK_PERIOD_NS = 10_000_000


def compress_lz4_for_ros(data: bytes) -> bytes:
    """LZ4 frame of the only form that ROS 1's `roslz4` reads.

    It wants independent blocks, no content size and a content checksum; with other flags, among them
    the defaults of lz4 and rosbags, `rosbag play` stops with "malformed data to decompress".
    """
    frame: bytes = lz4.frame.compress(
        data,
        block_size=lz4.frame.BLOCKSIZE_MAX1MB,
        block_linked=False,
        content_checksum=True,
        block_checksum=False,
        store_size=False,
    )
    return frame


class Rosbag1Writer(Writer):
    """One bag; a topic appears when its first sample does."""

    def __init__(
        self,
        target: str | Path,
        calibration: RigCalibration,
        *,
        profile: str = "standard",
        streams: Collection[str] | None = None,
        compression: str = "none",
        epoch_ns: int = DEFAULT_EPOCH_NS,
    ) -> None:
        """Prepare a bag.

        Args:
            target: File name, ending in ``.bag``.
            calibration: Where the sensors sit, and the cameras' intrinsics.
            profile: Name of a topic profile.
            streams: All streams that will come, so that a plain cloud is left out where the labelled
                one goes to the same topic; None: nothing is left out.
            compression: One of `COMPRESSIONS`.
            epoch_ns: Unix time of the drive's beginning [ns].

        Raises:
            WriterError: a name is unknown or the epoch is not positive.
        """
        super().__init__(target, epoch_ns=epoch_ns)
        if compression not in COMPRESSIONS:
            raise WriterError(unknown_name("bag compression", compression, COMPRESSIONS))
        if epoch_ns <= 0:
            raise WriterError(f"epoch {epoch_ns} ns; ROS needs times after 0")
        self._calibration = calibration
        self._profile = profile_by_name(profile)
        self._streams = streams
        self._compression = compression
        self._typestore = make_typestore(Stores.ROS1_NOETIC)
        pinholes = {camera.stream: camera.pinhole for camera in calibration.cameras}
        lenses = {camera.stream: camera.lens for camera in calibration.cameras}
        self._maker = MessageMaker(self._typestore, epoch_ns=epoch_ns, pinholes=pinholes, lenses=lenses)
        self._connections: dict[str, Connection] = {}
        self._clock_due_ns: int | None = None

    def _begin(self, part: Path) -> None:
        self._bag = BagFile(part)
        if self._compression != "none":
            self._bag.set_compression(BagFile.CompressionFormat[self._compression.upper()])
        if self._compression == "lz4":
            self._bag.compressor = compress_lz4_for_ros
        self._bag.open()

    def _put(self, sample: Sample) -> None:
        if self._clock_due_ns is None:
            self._write_tf_static(sample.stamp_ns)
            self._clock_due_ns = sample.stamp_ns
        if self._profile.clock and sample.stamp_ns >= self._clock_due_ns:
            self._clock_due_ns = sample.stamp_ns + _CLOCK_PERIOD_NS
            clock = self._maker.clock(sample.stamp_ns)
            self._write("/clock", "rosgraph_msgs/msg/Clock", sample.stamp_ns, clock)
        for route in self._profile.routes(type(sample), sample.sensor, self._streams):
            message = self._maker.make(route.message, sample, route.topic, route.frame_id)
            events = sample if isinstance(sample, Events) else None
            self._write(route.topic, ENCODERS[route.message][0], sample.stamp_ns, message, events=events)

    def _write_tf_static(self, stamp_ns: int) -> None:
        frames = self._calibration.frames
        if self._profile.tf_static and frames:
            message = self._maker.tf_static(BASE_FRAME, frames, stamp_ns)
            self._write("/tf_static", "tf2_msgs/msg/TFMessage", stamp_ns, message, latching=1)

    def _write(
        self,
        topic: str,
        type_name: str,
        stamp_ns: int,
        message: object,
        latching: int | None = None,
        events: Events | None = None,
    ) -> None:
        if topic not in self._connections:
            self._connections[topic] = self._bag.add_connection(
                topic, type_name, typestore=self._typestore, latching=latching
            )
        data = bytes(self._typestore.serialize_ros1(message, type_name))
        if events is not None:
            data = ros1_with_events(data, events, self.epoch_ns)
        self._bag.write(self._connections[topic], self.unix_ns(stamp_ns), data)

    def _finish(self) -> None:
        self._bag.close()

    def _drop(self) -> None:
        # Completing a bag needs disk space, which may be what is missing.
        if self._bag.bio is not None:
            self._bag.bio.close()
