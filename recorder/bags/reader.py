"""Opens bags of ROS 1 and ROS 2, and reads their messages."""

from __future__ import annotations

import heapq
import itertools
import logging
import re
import struct
from collections.abc import Collection, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO, TypeAlias

from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2 import storage_mcap
from rosbags.rosbag2.storage_mcap import McapReader, get_msgdef
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore

from carlaloc_env.core.errors import CarlaLocError, EvaluationError
from recorder.bags.files import files_of_bag

_LOG = logging.getLogger(__name__)
_CURES = {
    "not indexed": "{bag} was not closed by its recorder and has no index; run: rosbag reindex {bag}",
    "File end magic": "{bag} was cut off and lacks its end; run: mcap recover {bag} -o whole.mcap",
    "Profile is not ros2": "{bag} is an MCAP, but not of ROS 2; convert it to a bag of ROS 2 first",
}
"""Next steps after errors of rosbags, by a part of their text."""
Message: TypeAlias = tuple[Connection, int, bytes]
"""Connection, time of recording [ns] and serialized content of a message."""
_AHEAD, _FIRST = 8, 64
"""Number of messages that wait for late ones, and of the first ones, which show whether more must wait."""


@contextmanager
def open_bag(bag: Path) -> Iterator[AnyReader]:
    """A reader of a bag: a file (.bag, .mcap, .db3, also .zstd), or the folder of a ROS 2 or a split bag.

    Raises:
        EvaluationError: it is missing or damaged, was not closed, or is several bags.
    """
    with ExitStack() as stack:

        def scratch() -> Path:
            return Path(stack.enter_context(TemporaryDirectory(prefix="carlaloc-bag-")))

        with refused_in_one_line(bag):
            paths = files_of_bag(bag, scratch)
            try:
                reader = stack.enter_context(_reader(paths))
            except Exception:
                # Whatever rosbags makes of a definition; of a damaged file, the same error follows.
                reader = _reader(paths)
                reader.readers = [_Lenient(part) for part in reader.readers]  # type: ignore[assignment]
                stack.enter_context(reader)
            if reader.is2:
                _add_definitions(reader)
        yield reader


def _reader(paths: Sequence[Path]) -> AnyReader:
    reader = AnyReader(paths, default_typestore=get_typestore(Stores.EMPTY))
    for part in reader.readers:
        if isinstance(getattr(part, "storage", None), McapReader):
            part.storage = _McapFile(part.path)  # type: ignore[union-attr]
    return reader


class _McapFile(McapReader):
    """Reads files whose summary lacks a part, and unsorted messages without chunks; rosbags 0.11.9 cannot."""

    def open(self) -> None:
        """Open the file; topics of other encodings (JSON, Protobuf) are passed over."""
        definition, text = storage_mcap.get_msgdef, storage_mcap.read_string
        storage_mcap.get_msgdef, storage_mcap.read_string = _definition, _text
        try:
            super().open()
        finally:
            storage_mcap.get_msgdef, storage_mcap.read_string = definition, text
        others = [c.topic for c in self.connections if c.ext.serialization_format != "cdr"]  # type: ignore[union-attr]
        if others:
            _LOG.info("%s: passed over, not of ROS 2: %s", self.path, ", ".join(others))
        self.connections[:] = [c for c in self.connections if c.topic not in others]

    def read_index(self) -> None:
        super().read_index()
        bare = [chunk for chunk in self.chunks if not chunk.channel_count]
        if not (self.schemas and self.channels) or (bare and not self.statistics):
            self.connections.clear()
            self.meta_scan()
        for chunk in bare:
            chunk.channel_count.update(dict.fromkeys(self.channels, 1))

    def messages(
        self, connections: Collection[Connection], start: int | None = None, stop: int | None = None
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        read = super().messages if self.chunks else self.messages_scan
        yield from read(connections, start, stop)


def _add_definitions(reader: AnyReader) -> None:
    """Let a reader of ROS 2 know standard messages that the bag does not define, as until Humble.

    Those that are read here are the same in all distributions.
    """
    own = reader.typestore
    bare = {c.msgtype for c in reader.connections if c.msgdef.format == MessageDefinitionFormat.NONE}
    if bare - own.fielddefs.keys():
        store = get_typestore(Stores.ROS2_HUMBLE)
        for kind in store.fielddefs.keys() - own.fielddefs.keys():
            own.fielddefs[kind], own.types[kind] = store.fielddefs[kind], store.types[kind]


def _definition(schema: storage_mcap.Schema | None) -> MessageDefinition:
    ours = schema is not None and schema.encoding in ("ros2msg", "ros2idl", "omgidl", "")
    return get_msgdef(schema if ours else None)


def _text(bio: BinaryIO) -> str:
    return storage_mcap.read_bytes(bio).decode(errors="replace")


class _Lenient:
    """A reader of a file without those of its definitions that rosbags 0.11.9 does not understand.

    Such are services of ROS 2 Jazzy, which must not block the other topics.
    """

    def __init__(self, reader: Any) -> None:
        self._reader = reader

    def __enter__(self) -> _Lenient:
        self._reader.open()
        self.connections = [_understood(connection) for connection in self._reader.connections]
        return self

    def __exit__(self, *_: object) -> None:
        self._reader.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._reader, name)


def _understood(connection: Connection) -> Connection:
    try:
        if connection.msgdef.format == MessageDefinitionFormat.MSG:
            get_types_from_msg(connection.msgdef.data, connection.msgtype)
        elif connection.msgdef.format == MessageDefinitionFormat.IDL:
            for part in re.split(r"^=+\nIDL: .*\n", connection.msgdef.data, flags=re.MULTILINE):
                get_types_from_idl(part)
        return connection._replace(digest="")
    except (TypesysError, AssertionError):
        nothing = MessageDefinition(MessageDefinitionFormat.NONE, "")
        return connection._replace(digest="", msgdef=nothing)


@contextmanager
def refused_in_one_line(bag: Path) -> Iterator[None]:
    """Turn all errors of reading a bag into one line.

    Raises:
        EvaluationError: it raised anything.
    """
    try:
        yield
    except CarlaLocError:
        raise
    # A damaged bag makes the library raise whatever its parts do: struct, zlib, assertions, …
    except Exception as error:
        for words, cure in _CURES.items():
            if words in str(error):
                raise EvaluationError(cure.format(bag=bag)) from error
        why = f" ({error})" if isinstance(error, AnyReaderError) else ""
        raise EvaluationError(
            f"cannot read {bag}: no ROS bag, or a damaged one; give another{why}"
        ) from error


def messages_by_stamp(reader: AnyReader, connections: Sequence[Connection]) -> Iterator[Message]:
    """Messages that begin with a header, in the order of its stamps, not in that of their recording."""
    waiting: list[tuple[tuple[int, ...], int, int, Message]] = []
    ahead = _ahead(reader, connections)
    for number, message in enumerate(reader.messages(connections)):
        heapq.heappush(waiting, (_stamp(message[2], reader), message[1], number, message))
        if len(waiting) > ahead:
            yield heapq.heappop(waiting)[-1]
    yield from (heapq.heappop(waiting)[-1] for _ in range(len(waiting)))


def _ahead(reader: AnyReader, connections: Sequence[Connection]) -> int:
    """Number of messages that must wait: a few if the first ones are in order, else as many as all need."""
    times = ((_stamp(raw, reader), at_ns) for _, at_ns, raw in reader.messages(connections))
    first = list(itertools.islice(times, _FIRST))
    if first == sorted(first):
        return _AHEAD
    first += times
    return max(number - rank for rank, number in enumerate(sorted(range(len(first)), key=first.__getitem__)))


def _stamp(raw: bytes, reader: AnyReader) -> tuple[int, ...]:
    """Seconds and nanoseconds of a header, which follow ROS 1's counter or CDR's mark of the byte order."""
    order = ">" if reader.is2 and not raw[1] & 1 else "<"
    return struct.unpack_from(f"{order}2I", raw, 4)
