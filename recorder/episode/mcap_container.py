"""The MCAP container of an episode: chunks that reach the disk at once, and a reader that survives a cut.

The mcap library's own writer closes a chunk by size only; here a chunk is closed by time, and a file
that ends anywhere is read up to its last whole chunk. Record layouts come from the library
(`mcap.records`, format: https://mcap.dev/spec).
"""

import os
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from mcap.writer import MCAP0_MAGIC

from carlaloc_env.core.files.file_locks import take_lock
from recorder.episode.record_types import RecordType

_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<BQHIQQ")
_CHUNK_HEAD = struct.Struct("<QQQII")
_UNCOMPRESSED_MAX = 1 << 28
"""Largest chunk that is unpacked [byte]; a forged size must not fill the memory."""


class ContainerWriter:
    """Appends records to a new file; every chunk is one write to the disk."""

    def __init__(self, path: Path, *, durable: bool = True) -> None:
        """Create the file.

        Args:
            path: New file.
            durable: Wait at every chunk until the disk has it, so that a power cut loses no more
                than a killed process does.

        Raises:
            OSError: the file exists or cannot be created.
        """
        self._file = path.open("xb", buffering=0)
        # Until it is closed: a file that nobody holds belongs to a process that has ended.
        take_lock(self._file)
        self._durable = durable
        self._offset = 0
        self._compressor = zstandard.ZstdCompressor(level=3)
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._counts: dict[int, int] = {}
        self._chunks: list[ChunkIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._buffer = bytearray()
        self._index: dict[int, list[tuple[int, int]]] = {}
        self._append(MCAP0_MAGIC + _encoded(Header(profile="ros2", library="carlaloc")))

    @property
    def size_bytes(self) -> int:
        """Length of the file so far [bytes]."""
        return self._offset

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record now."""
        data = _encoded(Metadata(name=name, metadata=dict(values)))
        self._metadata.append(MetadataIndex(offset=self._offset, length=len(data), name=name))
        self._append(data)

    def add_channel(self, record: RecordType) -> int:
        """Declare a topic of CDR messages; its definition goes into the next chunk."""
        number = len(self._channels) + 1
        schema = Schema(id=number, name=record.name, encoding="ros2msg", data=record.definition.encode())
        channel = Channel(
            id=number, topic=record.topic, message_encoding="cdr", schema_id=number, metadata={}
        )
        self._schemas.append(schema)
        self._channels.append(channel)
        self._counts[number] = 0
        self._buffer += _encoded(schema) + _encoded(channel)
        return number

    def add_message(self, channel: int, stamp_ns: int, payload: bytes) -> None:
        """Append a message to the open chunk."""
        size = _MESSAGE.size - _RECORD.size + len(payload)
        head = _MESSAGE.pack(Opcode.MESSAGE, size, channel, self._counts[channel], stamp_ns, stamp_ns)
        offset = len(self._buffer)
        # In one piece: a Ctrl-C comes before it or after it.
        self._buffer += head + payload
        self._index.setdefault(channel, []).append((stamp_ns, offset))
        self._counts[channel] += 1

    def close_chunk(self) -> None:
        """Close the open chunk and put it on the disk."""
        if not self._buffer:
            return
        stamps = [stamp for entries in self._index.values() for stamp, _ in entries]
        first, last = min(stamps, default=0), max(stamps, default=0)
        data = self._compressor.compress(bytes(self._buffer))
        chunk = _encoded(
            Chunk(
                compression="zstd",
                data=data,
                message_start_time=first,
                message_end_time=last,
                uncompressed_crc=zlib.crc32(self._buffer),
                uncompressed_size=len(self._buffer),
            )
        )
        offsets: dict[int, int] = {}
        indices = b""
        for channel, entries in self._index.items():
            offsets[channel] = self._offset + len(chunk) + len(indices)
            indices += _encoded(MessageIndex(channel_id=channel, records=entries))
        entry = ChunkIndex(
            chunk_start_offset=self._offset,
            chunk_length=len(chunk),
            message_start_time=first,
            message_end_time=last,
            message_index_offsets=offsets,
            message_index_length=len(indices),
            compression="zstd",
            compressed_size=len(data),
            uncompressed_size=len(self._buffer),
        )
        begin, buffer, index = self._offset, self._buffer, self._index
        try:
            self._buffer, self._index = bytearray(), {}
            self._append(chunk + indices)
        except BaseException:
            # A Ctrl-C may come at any line: what is on the disk is not written again, what is not is kept.
            if self._offset == begin:
                self._buffer, self._index = buffer, index
            raise
        self._chunks.append(entry)
        if self._durable:
            os.fsync(self._file.fileno())

    def finish(self) -> None:
        """Close the chunk, write the summary and close the file."""
        self.close_chunk()
        self._append(_encoded(DataEnd(data_section_crc=0)))
        start = self._offset
        summary = b"".join(_encoded(record) for record in self._summary())
        footer_head = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, 0)
        crc = zlib.crc32(footer_head, zlib.crc32(summary))
        footer = _encoded(Footer(summary_start=start, summary_offset_start=0, summary_crc=crc))
        self._append(summary + footer + MCAP0_MAGIC)
        os.fsync(self._file.fileno())
        self._file.close()

    def abandon(self) -> None:
        """Close the file as it is; closed chunks stay readable."""
        self._file.close()

    def _summary(self) -> list[McapRecord]:
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            metadata_count=len(self._metadata),
            message_start_time=min((c.message_start_time for c in self._chunks), default=0),
            message_end_time=max((c.message_end_time for c in self._chunks), default=0),
            schema_count=len(self._schemas),
        )
        return [*self._schemas, *self._channels, statistics, *self._chunks, *self._metadata]

    def _append(self, data: bytes) -> None:
        view, end = memoryview(data), self._offset + len(data)
        try:
            while view:
                view = view[self._file.write(view) :]
            self._offset = end
        except BaseException:
            # A full disk or a Ctrl-C may have left half a record; without it the file stays readable.
            os.ftruncate(self._file.fileno(), self._offset)
            self._file.seek(self._offset)
            raise


NOT_CLOSED, CUT_OFF = "the file was not closed", "its last record is cut off"
"""Problems of a file that was read as far as it was written."""


@dataclass(slots=True)
class Container:
    """Records that were read from a file, up to its first damage."""

    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    """Metadata records in file order."""
    payloads: dict[str, list[bytes]] = field(default_factory=dict)
    """Message payloads of every topic in file order."""
    stamps_ns: dict[str, list[int]] = field(default_factory=dict)
    """Stamps of the same messages [ns]."""
    last_good_ns: int = 0
    """Newest stamp of a whole message [ns]."""
    problem: str | None = None
    """Why the file is not whole, or None."""


def is_container(data: bytes) -> bool:
    """Whether the bytes begin as an MCAP file does."""
    return data[: len(MCAP0_MAGIC)] == MCAP0_MAGIC


def read_container(data: bytes) -> Container:
    """Everything up to the end or to the first damaged record."""
    container = Container()
    topics: dict[int, str] = {}
    at, size = len(MCAP0_MAGIC), len(data)
    while True:
        if at + _RECORD.size > size:
            container.problem = NOT_CLOSED
            return container
        opcode, length = _RECORD.unpack_from(data, at)
        at += _RECORD.size
        if at + length > size:
            container.problem = CUT_OFF
            return container
        try:
            if opcode == Opcode.CHUNK:
                _read_messages(_unpacked(data[at : at + length]), topics, container)
            elif opcode == Opcode.METADATA:
                record = Metadata.read(ReadDataStream(BytesIO(data[at : at + length])))
                container.metadata.append((record.name, record.metadata))
        except (ValueError, struct.error, zstandard.ZstdError, McapError) as error:
            container.problem = f"a record at byte {at} is damaged ({error})"
            return container
        at += length
        if opcode == Opcode.FOOTER:
            if data[at : at + len(MCAP0_MAGIC)] != MCAP0_MAGIC:
                container.problem = "its last bytes are missing"
            return container


def _unpacked(record: bytes) -> bytes:
    _, _, size, crc, name_length = _CHUNK_HEAD.unpack_from(record)
    at = _CHUNK_HEAD.size
    compression = record[at : at + name_length]
    body = record[at + name_length + 8 :]
    if size > _UNCOMPRESSED_MAX:
        raise ValueError(f"chunk of {size} bytes")
    if compression == b"zstd":
        # Where a frame names its size, zstandard believes that and not max_output_size.
        if zstandard.frame_content_size(body) not in (-1, size):
            raise ValueError("chunk whose size differs from its header")
        body = zstandard.ZstdDecompressor().decompress(body, max_output_size=size)
    elif compression:
        raise ValueError(f"chunk compression {compression!r}")
    if crc and zlib.crc32(body) != crc:
        raise ValueError("checksum differs")
    return body


def _read_messages(body: bytes, topics: dict[int, str], container: Container) -> None:
    at, size = 0, len(body)
    while at < size:
        opcode, length = _RECORD.unpack_from(body, at)
        end = at + _RECORD.size + length
        if end > size:
            raise ValueError("message longer than its chunk")
        if opcode == Opcode.MESSAGE:
            _, _, channel, _, stamp_ns, _ = _MESSAGE.unpack_from(body, at)
            if channel not in topics:
                raise ValueError(f"message of unknown channel {channel}")
            container.payloads[topics[channel]].append(body[at + _MESSAGE.size : end])
            container.stamps_ns[topics[channel]].append(stamp_ns)
            container.last_good_ns = max(container.last_good_ns, stamp_ns)
        elif opcode == Opcode.CHANNEL:
            channel_record = Channel.read(ReadDataStream(BytesIO(body[at + _RECORD.size : end])))
            topics[channel_record.id] = channel_record.topic
            container.payloads.setdefault(channel_record.topic, [])
            container.stamps_ns.setdefault(channel_record.topic, [])
        at = end


def _encoded(record: McapRecord) -> bytes:
    builder: Any = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()
    return data
