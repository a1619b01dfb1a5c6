"""The MCAP container of an episode: chunks that reach the disk at once, and a reader that survives a cut."""

import _thread
import os
import struct
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from queue import SimpleQueue

import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, Footer, McapRecord, Message, Metadata
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC, Writer

from carlaloc_env.core.files.file_locks import take_lock
from recorder.episode.record_types import RecordType

_RECORD = struct.Struct("<BQ")
_UNCOMPRESSED_MAX = 1 << 28
"""Largest chunk that is unpacked [byte]; a forged size must not fill the memory."""
NOT_CLOSED, CUT_OFF = "the file was not closed", "its last record is cut off"
"""Problems of a file that was read as far as it was written."""


class ContainerWriter:
    """Appends records to a new file."""

    def __init__(self, path: Path, *, durable: bool = True) -> None:
        """Create the file.

        Args:
            path: New file.
            durable: Wait at every chunk until the disk has it, so that a power cut loses no more
                than a killed process does.

        Raises:
            OSError: the file exists or cannot be created.
        """
        self._path, self._durable = path, durable
        self._file = path.open("xb")
        # Until it is closed: a file that nobody holds belongs to a process that has ended.
        take_lock(self._file)
        self.size_bytes = 0
        """Length of the file so far [bytes]."""
        self._waiting: deque[tuple[int, int, bytes]] = deque()
        self._writer = Writer(self._file)
        self._busy = _thread.allocate_lock()
        self._write(lambda: self._writer.start("ros2", "carlaloc"))

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record now."""
        self._write(lambda: self._writer.add_metadata(name, dict(values)))

    def add_channel(self, record: RecordType) -> int:
        """Declare a topic of CDR messages; its definition goes into the next chunk."""
        schema = self._writer.register_schema(record.name, "ros2msg", record.definition.encode())
        return self._writer.register_channel(record.topic, "cdr", schema)

    def add_message(self, channel: int, stamp_ns: int, payload: bytes) -> None:
        """Append a message to the open chunk."""
        self._waiting.append((channel, stamp_ns, payload))

    def close_chunk(self, later: Callable[[], Iterable[tuple[int, int, bytes]]] = tuple) -> None:
        """Close the open chunk and put it on the disk.

        Args:
            later: Further messages: channel, stamp [ns], bytes. It is called where no Ctrl-C comes.
        """

        def add() -> None:
            self._waiting.extend(later())
            self._add_waiting()

        self._write(add, sync=self._durable)

    def finish(self) -> None:
        """Close the chunk, write the summary and close the file."""
        self.close_chunk()
        self._write(self._writer.finish, sync=True)
        self.abandon()

    def abandon(self) -> None:
        """Close the file as it is; closed chunks stay readable."""
        with self._busy:
            self._file.close()

    def _add_waiting(self) -> None:
        while self._waiting:
            channel, stamp_ns, payload = self._waiting.popleft()
            self._writer.add_message(channel, stamp_ns, payload, stamp_ns)
        self._writer.flush()

    def _write(self, change: Callable[[], None], *, sync: bool = False) -> None:
        outcome: SimpleQueue[Exception | None] = SimpleQueue()

        def run() -> None:
            with self._busy:
                try:
                    change()
                    self._file.flush()
                    self.size_bytes = self._file.tell()
                    if sync:
                        os.fsync(self._file.fileno())
                    outcome.put(None)
                except Exception as error:
                    # A full disk has half a record, without which the file is readable; closing adds to it.
                    with suppress(OSError):
                        self._file.close()
                    with suppress(OSError):
                        os.truncate(self._path, self.size_bytes)
                    outcome.put(error)

        # A Ctrl-C comes in the main thread alone, where it would leave the library with half a record. It may
        # come between any two instructions of Python, hence nothing here that takes several for one lock.
        _thread.start_new_thread(run, ())
        if (error := outcome.get()) is not None:
            raise error


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
    container, topics = Container(), dict[int, str]()
    stream, end, record = BytesIO(data), len(MCAP0_MAGIC), None
    try:
        for record in StreamReader(stream, emit_chunks=True, record_size_limit=len(data)).records:
            if isinstance(record, Chunk):
                for part in _unpacked(record):
                    _add(part, topics, container)
            elif isinstance(record, Metadata):
                container.metadata.append((record.name, record.metadata))
            end = stream.tell()
    except (ValueError, OverflowError, struct.error, zstandard.ZstdError, McapError) as error:
        container.problem = _problem(data, end, record, error)
    return container


def _problem(data: bytes, end: int, last: McapRecord | None, error: Exception) -> str:
    """Why reading ended with an error after a last whole record."""
    if isinstance(last, Footer):
        return "its last bytes are missing"
    begin = end + _RECORD.size
    if begin > len(data):
        return NOT_CLOSED
    if begin + _RECORD.unpack_from(data, end)[1] > len(data):
        return CUT_OFF
    return f"a record at byte {begin} is damaged ({error})"


def _unpacked(chunk: Chunk) -> list[McapRecord]:
    if chunk.uncompressed_size > _UNCOMPRESSED_MAX:
        raise ValueError(f"chunk of {chunk.uncompressed_size} bytes")
    if chunk.compression not in ("", "zstd"):
        raise ValueError(f"chunk compression {chunk.compression!r}")
    # Where a frame names its size, zstandard believes that and not the limit that the library gives.
    if chunk.compression and zstandard.frame_content_size(chunk.data) not in (-1, chunk.uncompressed_size):
        raise ValueError("chunk whose size differs from its header")
    return breakup_chunk(chunk, validate_crc=True)


def _add(record: McapRecord, topics: dict[int, str], container: Container) -> None:
    if isinstance(record, Channel):
        topics[record.id] = record.topic
        container.payloads.setdefault(record.topic, [])
        container.stamps_ns.setdefault(record.topic, [])
    elif isinstance(record, Message):
        if record.channel_id not in topics:
            raise ValueError(f"message of unknown channel {record.channel_id}")
        container.payloads[topics[record.channel_id]].append(record.data)
        container.stamps_ns[topics[record.channel_id]].append(record.log_time)
        container.last_good_ns = max(container.last_good_ns, record.log_time)
