"""Stores messages of a ROS 2 bag as MCAP: zstd chunks with checksums, schemas inside."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType
from mcap.writer import Writer as McapFile
from rosbags.interfaces import Connection
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagFile

CHUNK_BYTES = 1 << 20
"""Size from which a chunk is closed, before it is compressed [bytes]."""


class McapStorage:
    """Storage that `rosbags.rosbag2.Writer` calls for each message.

    That of rosbags 0.11.9 packs no chunk and writes no checksums, attachments and records of one's own.

    Args:
        path: Folder of the bag; the file is named after it.
        _: Mode of compression, which is always that of chunks.
    """

    def __init__(self, path: Path, _: Any) -> None:
        self.path = path / f"{path.name}.mcap"
        self._disk = self.path.open("xb")
        self._file: Any = McapFile(self._disk, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._file.start(profile="ros2", library="carlaloc")
        self._schemas: dict[str, int] = {}
        self._channels: dict[int, int] = {}

    def describe(
        self, metadata: Mapping[str, Mapping[str, str]], attachments: Mapping[str, str], time_ns: int
    ) -> None:
        """Add what belongs to the whole recording.

        Args:
            metadata: Texts by key, by name of the record.
            attachments: Texts by file name.
            time_ns: Time of the recording's beginning [ns since 1970].
        """
        for name, values in metadata.items():
            self._file.add_metadata(name, dict(values))
        for name, text in attachments.items():
            kind = "application/yaml" if name.endswith(".yaml") else "text/plain"
            self._file.add_attachment(time_ns, time_ns, name, kind, text.encode())

    def add_msgtype(self, connection: Connection) -> None:
        """Add the definition of a type."""
        self._schemas[connection.msgtype] = self._file.register_schema(
            connection.msgtype, "ros2msg", connection.msgdef.data.encode()
        )

    def add_connection(self, connection: Connection, offered_qos_profiles: str) -> None:
        """Add a topic."""
        schema = self._schemas[connection.msgtype]
        self._channels[connection.id] = self._file.register_channel(
            connection.topic, "cdr", schema, {"offered_qos_profiles": offered_qos_profiles}
        )

    def write(self, connection: Connection, timestamp: int, data: bytes | memoryview) -> None:
        """Add a message."""
        self._file.add_message(self._channels[connection.id], timestamp, bytes(data), timestamp)

    def close(self, version: int, metadata: str) -> None:
        """Complete the file."""
        self._file.add_metadata("rosbag2", {"serialized_metadata": metadata})
        self._file.finish()
        self._disk.close()

    def abort(self) -> None:
        """Close the file without completing it."""
        self._disk.close()


class McapBag(BagFile):
    """`rosbags.rosbag2.Writer` with this storage."""

    STORAGE_PLUGINS = {**BagFile.STORAGE_PLUGINS, StoragePlugin.MCAP: McapStorage}  # noqa: RUF012
