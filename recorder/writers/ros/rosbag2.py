"""ROS 2 bags, written without ROS: MCAP with zstd chunks, or SQLite."""

import sqlite3
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Literal

from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores

from carlaloc_env.core.errors import WriterError, unknown_name
from carlaloc_env.samples import Events
from recorder.writers.base import Piece
from recorder.writers.ros.bag_writer import BagEncoder, BagWriter
from recorder.writers.ros.event_messages import cdr_with_events
from recorder.writers.ros.mcap_storage import McapBag, McapStorage
from recorder.writers.ros.message_parts import Message

STORAGES = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}
"""Ways to store a bag."""
METADATA = "carlaloc_sequence"
"""Name of MCAP's metadata record with the conditions of a sequence."""
VERSION: Literal[8] = 8
"""Version of ``metadata.yaml``, the last one that Humble and Iron read; Jazzy and later read it, too.

In version 9 the quality of service is a list of words, where Humble's yaml-cpp wants a text with numbers.
"""
_FOREVER = QosTime(9223372036, 854775807)


def _qos(*, latched: bool) -> Qos:
    """Quality of service: reliable; late subscribers get latched messages too."""
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=1 if latched else 10,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        deadline=_FOREVER,
        lifespan=_FOREVER,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=_FOREVER,
        avoid_ros_namespace_conventions=False,
    )


class Ros2Encoder(BagEncoder):
    """Messages as CDR, for ROS 2; the arguments are those of `BagEncoder`."""

    store = Stores.ROS2_HUMBLE

    def serialise(self, message: Message, kind: str) -> bytes:
        """A message as it stands in the bag."""
        return bytes(self.typestore.serialize_cdr(message, kind))

    def deserialise(self, data: bytes, kind: str) -> Message:
        """The message of its bytes."""
        return self.typestore.deserialize_cdr(data, kind)

    def _with_events(self, empty: bytes, sample: Events) -> bytes:
        return cdr_with_events(empty, sample, self.epoch_ns)


class Rosbag2Writer(BagWriter):
    """One folder with ``metadata.yaml`` and the messages, with all definitions inside.

    Args:
        target: Folder of the bag.
        encoder: Makes the messages.
        storage: One of `STORAGES`.
        about: Texts by name that go into the bag's metadata, e.g. its conditions; in MCAP they are
            also the metadata record ``carlaloc_sequence``.
        attachments: Texts by file name that MCAP carries as attachments, e.g. calibration.

    Raises:
        WriterError: the storage is unknown.
    """

    def __init__(
        self,
        target: str | Path,
        encoder: Ros2Encoder,
        *,
        storage: str = "mcap",
        about: Mapping[str, str] | None = None,
        attachments: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(target, encoder)
        if storage not in STORAGES:
            raise WriterError(unknown_name("storage of a bag", storage, STORAGES))
        self._storage = STORAGES[storage]
        self._about = dict(about or {})
        self._attachments = dict(attachments or {})
        self._connections: dict[str, Connection] = {}

    def _begin(self, part: Path) -> None:
        part.mkdir(parents=True)
        # The library names files after the folder, which has another name until it is whole.
        self._bag = McapBag(part / self.target.name, version=VERSION, storage_plugin=self._storage)
        for name, text in self._about.items():
            self._bag.set_custom_data(name, text)
        self._bag.open()
        if isinstance(self._bag.storage, McapStorage):
            about = {METADATA: self._about} if self._about else {}
            self._bag.storage.describe(about, self._attachments, self.encoder.epoch_ns)

    def _add(self, piece: Piece, *, latched: bool = False) -> None:
        topic = piece.place
        if topic not in self._connections:
            self._connections[topic] = self._bag.add_connection(
                topic,
                piece.kind,
                typestore=self.encoder.typestore,
                offered_qos_profiles=[_qos(latched=latched)],
            )
        self._bag.write(self._connections[topic], self.encoder.unix_ns(piece.stamp_ns), piece.data)

    def _finish(self) -> None:
        self._bag.close()
        inner = self._part / self.target.name
        for path in inner.iterdir():
            path.rename(self._part / path.name)
        inner.rmdir()

    def _drop(self) -> None:
        if self._bag.storage is not None:
            with suppress(OSError, sqlite3.Error):
                self._bag.storage.abort()
