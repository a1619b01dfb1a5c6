"""ROS 1 bags, written without ROS."""

from pathlib import Path

import lz4.frame  # type: ignore[import-untyped]
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Writer as BagFile
from rosbags.typesys import Stores

from carlaloc_env.core.errors import WriterError, unknown_name
from carlaloc_env.samples import Events
from recorder.writers.base import Piece, close_unfinished
from recorder.writers.ros.bag_writer import BagEncoder, BagWriter
from recorder.writers.ros.event_messages import ros1_with_events
from recorder.writers.ros.message_parts import Message

COMPRESSIONS = ("none", "lz4", "bz2")
"""Ways to compress a bag's chunks."""


def compress_lz4_for_ros(data: bytes) -> bytes:
    """LZ4 frame of the only form that ROS 1's `roslz4` reads.

    It wants independent blocks, no content size and a content checksum; with other flags, among them
    the defaults of lz4 and rosbags 0.11.9, `rosbag play` stops with "malformed data to decompress".
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


def bag1_file(path: Path, compression: str) -> BagFile:
    """A bag that is not open yet, its chunks compressed by one of `COMPRESSIONS`."""
    bag = BagFile(path)
    if compression != "none":
        bag.set_compression(BagFile.CompressionFormat[compression.upper()])
    if compression == "lz4":
        bag.compressor = compress_lz4_for_ros
    return bag


class Ros1Encoder(BagEncoder):
    """Messages as ROS 1 serialises them; the arguments are those of `BagEncoder`."""

    store = Stores.ROS1_NOETIC

    def serialise(self, message: Message, kind: str) -> bytes:
        """A message as it stands in the bag."""
        return bytes(self.typestore.serialize_ros1(message, kind))

    def deserialise(self, data: bytes, kind: str) -> Message:
        """The message of its bytes."""
        return self.typestore.deserialize_ros1(data, kind)

    def _with_events(self, empty: bytes, sample: Events) -> bytes:
        return ros1_with_events(empty, sample, self.epoch_ns)


class Rosbag1Writer(BagWriter):
    """One ``.bag`` file.

    Args:
        target: The file.
        encoder: Makes the messages.
        compression: One of `COMPRESSIONS`.

    Raises:
        WriterError: the compression is unknown.
    """

    def __init__(self, target: str | Path, encoder: Ros1Encoder, *, compression: str = "none") -> None:
        super().__init__(target, encoder)
        if compression not in COMPRESSIONS:
            raise WriterError(unknown_name("bag compression", compression, COMPRESSIONS))
        self._compression = compression
        self._connections: dict[str, Connection] = {}
        self._counts: dict[str, int] = {}

    def _begin(self, part: Path) -> None:
        self._bag = bag1_file(part, self._compression)
        self._bag.open()

    def _add(self, piece: Piece, *, latched: bool = False) -> None:
        if piece.place not in self._connections:
            self._connections[piece.place] = self._bag.add_connection(
                piece.place, piece.kind, typestore=self.encoder.typestore, latching=1 if latched else None
            )
        data = piece.data
        if self.encoder.maker.fields_of(piece.kind.replace("/msg/", "/"))[0] == "header":
            # Its first field is `seq`, the number of the message on its topic.
            seq = self._counts.get(piece.place, 0)
            self._counts[piece.place] = seq + 1
            data = seq.to_bytes(4, "little") + data[4:]
        self._bag.write(self._connections[piece.place], self.encoder.unix_ns(piece.stamp_ns), data)

    def _finish(self) -> None:
        self._bag.close()

    def _drop(self) -> None:
        # Completing a bag needs disk space, which may be what is missing.
        if self._bag.bio is not None:
            close_unfinished([self._bag.bio])
