"""What writers of ROS 1 and ROS 2 bags share: which sample becomes which message on which topic."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection
from pathlib import Path

from rosbags.typesys import Stores

from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import Events, Sample
from recorder.writers.base import DEFAULT_EPOCH_NS, Writer
from recorder.writers.rig_calibration import BASE_FRAME, RigCalibration
from recorder.writers.ros.message_parts import Message, make_typestore
from recorder.writers.ros.messages import ENCODERS, MessageMaker
from recorder.writers.topics import profile_by_name

_CLOCK_PERIOD_NS = 10_000_000


class BagWriter(Writer):
    """Turns samples into messages; a topic appears when its first sample does."""

    def __init__(
        self,
        target: str | Path,
        calibration: RigCalibration,
        *,
        store: Stores,
        profile: str = "standard",
        streams: Collection[str] | None = None,
        epoch_ns: int = DEFAULT_EPOCH_NS,
    ) -> None:
        """Prepare a bag.

        Args:
            target: File or folder of the bag.
            calibration: Where the sensors sit, and the cameras' intrinsics.
            store: Version of ROS whose messages are written.
            profile: Name of a topic profile.
            streams: All streams that will come, so that a plain cloud is left out where the labelled
                one goes to the same topic; None: nothing is left out.
            epoch_ns: Unix time of the drive's beginning [ns].

        Raises:
            WriterError: the profile is unknown or the epoch is not positive.
        """
        super().__init__(target, epoch_ns=epoch_ns)
        if epoch_ns <= 0:
            raise WriterError(f"epoch {epoch_ns} ns; ROS needs times after 0")
        self._calibration = calibration
        self._profile = profile_by_name(profile)
        self._streams = streams
        self._typestore = make_typestore(store)
        pinholes = {camera.stream: camera.pinhole for camera in calibration.cameras}
        lenses = {camera.stream: camera.lens for camera in calibration.cameras}
        self._maker = MessageMaker(self._typestore, epoch_ns=epoch_ns, pinholes=pinholes, lenses=lenses)
        self._clock_due_ns: int | None = None

    def _put(self, sample: Sample) -> None:
        if self._clock_due_ns is None:
            self._write_tf_static(sample.stamp_ns)
            self._clock_due_ns = sample.stamp_ns
        if self._profile.clock and sample.stamp_ns >= self._clock_due_ns:
            self._clock_due_ns = sample.stamp_ns + _CLOCK_PERIOD_NS
            clock = self._maker.clock(sample.stamp_ns)
            self._add("/clock", "rosgraph_msgs/msg/Clock", sample.stamp_ns, clock)
        for route in self._profile.routes(type(sample), sample.sensor, self._streams):
            message = self._maker.make(route.message, sample, route.topic, route.frame_id)
            events = sample if isinstance(sample, Events) else None
            self._add(route.topic, ENCODERS[route.message][0], sample.stamp_ns, message, events=events)

    def _write_tf_static(self, stamp_ns: int) -> None:
        frames = self._calibration.frames
        if self._profile.tf_static and frames:
            message = self._maker.tf_static(BASE_FRAME, frames, stamp_ns)
            self._add("/tf_static", "tf2_msgs/msg/TFMessage", stamp_ns, message, latched=True)

    @abstractmethod
    def _add(
        self,
        topic: str,
        type_name: str,
        stamp_ns: int,
        message: Message,
        *,
        latched: bool = False,
        events: Events | None = None,
    ) -> None:
        """Append a message.

        Args:
            topic: Its topic.
            type_name: Its type, e.g. ``sensor_msgs/msg/Imu``.
            stamp_ns: Time since the drive began [ns].
            message: Object of the type store.
            latched: Whether those who subscribe later get it too.
            events: Events that stand in the message in place of its empty list.
        """
