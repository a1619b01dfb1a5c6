"""Bags of ROS 1 and ROS 2: their files, an open reader, definitions that files lack.

Files are recognised by content, not by name. ROS 2 bags lack definitions of messages until Humble.
"""

from __future__ import annotations

import functools
import heapq
import itertools
import logging
import re
import shutil
import sqlite3
import struct
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeAlias

import yaml
import zstandard
from mcap.exceptions import McapError
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from carlaloc_env.core.errors import CarlaLocError, EvaluationError

_LOG = logging.getLogger(__name__)

METADATA = "metadata.yaml"
"""What rosbag2 writes beside the files of a bag when it closes it."""
_ROS1, _SQLITE, _MCAP, _ZSTD = ".bag", ".db3", ".mcap", ".zstd"
_BEGINNINGS = {
    b"#ROSBAG V": _ROS1,
    b"SQLite format 3\0": _SQLITE,
    b"\x89MCAP0\r\n": _MCAP,
    b"\x28\xb5\x2f\xfd": _ZSTD,
}
"""First bytes of a file, and the suffix by which rosbags knows its kind."""
_PACKED = {b"\x1f\x8b": "gzip", b"BZh": "bzip2", b"\xfd7zXZ": "xz", b"PK\x03\x04": "zip", b"7z\xbc\xaf": "7z"}
_PART = re.compile(r"(?P<name>.*?)(?:_?\d{4}(?:-\d\d){5})?_(?P<number>\d+)")
"""Stem of a part of a split bag, which recorders count from 0: ``run_3``, ``run_2026-11-26-09-30-00_3``."""


def files_of_bag(path: Path, scratch: Callable[[], Path]) -> list[Path]:
    """Paths that `rosbags` reads as one bag.

    A file is itself, whatever lies beside it. A folder with a ``metadata.yaml`` is a ROS 2 bag; another
    folder is the one bag in it, which may be split into numbered files.

    Args:
        path: A file of ROS 1, MCAP or SQLite, compressed by zstd or not, or a folder.
        scratch: Makes an empty folder for what must be unpacked or called otherwise.

    Raises:
        EvaluationError: there is none, or there are several.
    """
    if path.name == METADATA:
        path = path.parent
    if path.is_dir():
        return _of_folder(path, scratch)
    if not path.is_file():
        raise EvaluationError(f"{path}: no such bag; give a file (.bag, .mcap, .db3) or a folder of ROS 2")
    kind = kind_of(path)
    if kind == _ZSTD:
        return files_of_bag(_unpacked(path, scratch), scratch)
    if _has_packed_messages(described := metadata_of(path)):
        if len(described["relative_file_paths"]) > 1:
            raise EvaluationError(
                f"{path} is a part of a bag whose messages are compressed; give its folder {path.parent}"
            )
        return [path.parent]
    return [_file(path, kind, scratch)]


def kind_of(path: Path) -> str:
    """Suffix that fits a file's first bytes: ``.bag``, ``.db3``, ``.mcap`` or ``.zstd``.

    Raises:
        EvaluationError: it is none of these.
    """
    with path.open("rb") as file:
        begin = file.read(16)
    for sign, kind in _BEGINNINGS.items():
        if begin.startswith(sign):
            return kind
    for sign, packer in _PACKED.items():
        if begin.startswith(sign):
            raise EvaluationError(f"{path} is packed by {packer}; unpack it, and give the bag in it")
    raise EvaluationError(f"cannot read {path}: no ROS bag, or a damaged one; give another")


def metadata_of(path: Path) -> dict[str, Any]:
    """Content of ``metadata.yaml`` for a folder, or for a file that it names beside it; else nothing."""
    file = (path if path.is_dir() else path.parent) / METADATA
    try:
        found = _information(file.read_text("utf-8"))
        names = [Path(name).name for name in found["relative_file_paths"]]
    # Whatever is wrong with it: the files are read without it.
    except (OSError, ValueError, TypeError, KeyError, yaml.YAMLError):
        return {}
    return dict(found) if path.is_dir() or path.name in names else {}


@functools.lru_cache(maxsize=4)
def _information(metadata: str) -> Any:
    """Content of a ``metadata.yaml``; a folder and each of its files need it, and parsing takes long."""
    return yaml.safe_load(metadata)["rosbag2_bagfile_information"]


def _of_folder(folder: Path, scratch: Callable[[], Path]) -> list[Path]:
    if described := metadata_of(folder):
        # Only rosbags' reader of folders unpacks messages. It reads nothing where files and metadata.yaml
        # differ in a topic's quality of service, as after `ros2 bag reindex`: files are read by themselves.
        if _has_packed_messages(described):
            return [folder]
        named = [folder / Path(name).name for name in described["relative_file_paths"]]
        if missing := [file.name for file in named if not file.is_file()]:
            raise EvaluationError(
                f"{folder}: {METADATA} names {', '.join(missing)}, not there; give the file that is"
            )
        return [part for file in named for part in files_of_bag(file, scratch)]
    inside = sorted(folder.iterdir())
    files = [p for p in inside if p.is_file() and _suffix(p) in (_ROS1, _SQLITE, _MCAP)]
    if not files:
        files = [p for p in inside if p.is_dir() and (p / METADATA).is_file()]
    if not files:
        raise EvaluationError(f"{folder} holds no bag; give a file (.bag, .mcap, .db3) or a folder of ROS 2")
    if len(files) > 1 and (files[0].is_dir() or not _is_split(files)):
        names = ", ".join(file.name for file in files)
        raise EvaluationError(f"{folder} holds {len(files)} bags; give one of them: {names}")
    if len(files) > 1:
        _LOG.warning("%s: %d files are read as the parts of one bag", folder, len(files))
    return [part for file in files for part in files_of_bag(file, scratch)]


def _suffix(path: Path) -> str:
    """Suffix of a bag's name, before ``.zstd``."""
    return Path(path.stem).suffix if path.suffix == _ZSTD else path.suffix


def _is_split(files: Sequence[Path]) -> bool:
    """Whether names differ by the number of the part alone."""
    stems = [file.name.removesuffix(_ZSTD).removesuffix(_suffix(file)) for file in files]
    parts = [part for stem in stems if (part := _PART.fullmatch(stem))]
    names = {(part["name"], _suffix(file)) for part, file in zip(parts, files, strict=False)}
    numbers = {int(part["number"]) for part in parts}
    return len(names) == 1 and numbers == set(range(len(files)))


def _unpacked(path: Path, scratch: Callable[[], Path]) -> Path:
    to = scratch() / path.name.removesuffix(path.suffix)
    with path.open("rb") as packed, to.open("wb") as file:
        try:
            reader = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
            shutil.copyfileobj(reader, file)
        except zstandard.ZstdError as error:
            raise EvaluationError(f"cannot unpack {path}: {error}; give a whole one") from error
    return to


def _has_packed_messages(described: dict[str, Any]) -> bool:
    return str(described.get("compression_mode")).lower() == "message"


def _file(path: Path, kind: str, scratch: Callable[[], Path]) -> Path:
    """The path, or a link to it by a name that ends as rosbags wants it."""
    log = path.with_name(f"{path.name}-wal")
    if kind == _SQLITE and log.is_file() and log.stat().st_size:
        raise EvaluationError(
            f"{path} was not closed by its recorder: messages are still in {log.name}; "
            f"run: sqlite3 {path} 'PRAGMA wal_checkpoint(TRUNCATE)'"
        )
    if path.suffix == kind:
        return path
    link = scratch() / f"{path.stem}{kind}"
    link.symlink_to(path.resolve())
    return link


LIKELIEST = "humble"
"""Distribution that is taken where a bag names none: the last one whose bags carry no definitions."""
_OF_VERSION = {
    1: "dashing", 2: "eloquent", 3: "foxy", 4: "foxy", 5: "humble", 6: "iron", 7: "iron", 8: "jazzy",
    9: "jazzy",
}  # fmt: skip
"""First distribution with a version of rosbag2's metadata (bag_metadata.hpp) or a later one."""


def add_definitions(reader: AnyReader, path: Path, bag: Path) -> None:
    """Let a reader of ROS 2, by its first file, know standard messages that the bag does not define."""
    bare = {c.msgtype for c in reader.connections if c.msgdef.format == MessageDefinitionFormat.NONE}
    if not bare - reader.typestore.fielddefs.keys():
        return
    name = _distribution(path)
    store, known = get_typestore(Stores[f"ROS2_{(name or LIKELIEST).upper()}"]), reader.typestore
    if not bare & store.fielddefs.keys():
        return
    if name is None:
        _LOG.warning(
            "%s names no ROS distribution and defines no messages: read with those of %s", bag, LIKELIEST
        )
    for kind in store.fielddefs.keys() - known.fielddefs.keys():
        known.fielddefs[kind], known.types[kind] = store.fielddefs[kind], store.types[kind]


def _distribution(path: Path) -> str | None:
    """Distribution that a bag names, or that wrote its version of the metadata; None: it shows neither."""
    described = metadata_of(path)
    if not path.is_dir():
        inside = (_of_mcap if path.suffix == ".mcap" else _of_sqlite)(path)
        described = {**inside, **{name: value for name, value in described.items() if value}}
    named = str(described.get("ros_distro")).lower()
    if f"ROS2_{named.upper()}" in Stores.__members__:
        return named
    version = described.get("version")
    return _OF_VERSION.get(version) if isinstance(version, int) else None


def _of_mcap(path: Path) -> Mapping[str, Any]:
    """What rosbag2 wrote into the MCAP's own metadata."""
    try:
        with path.open("rb") as file:
            for record in make_reader(file).iter_metadata():
                if record.name == "rosbag2":
                    described = yaml.safe_load(record.metadata.get("serialized_metadata", "")) or {}
                    distribution = record.metadata.get("ROS_DISTRO", described.get("ros_distro"))
                    return {**described, "ros_distro": distribution}
    except (McapError, yaml.YAMLError, AttributeError, TypeError):
        pass
    return {}


def _of_sqlite(path: Path) -> Mapping[str, Any]:
    """Distribution in the table ``schema``, new in Humble; before, topics distinguish Foxy from Eloquent."""
    try:
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?immutable=1", uri=True)) as base:
            columns = {row[1] for row in base.execute("PRAGMA table_info(schema)")}
            if "ros_distro" in columns:
                row = base.execute("SELECT ros_distro FROM schema").fetchone()
                return {"ros_distro": row[0]} if row else {}
            if columns:
                return {}
            topics = {row[1] for row in base.execute("PRAGMA table_info(topics)")}
            return {"version": 4 if "offered_qos_profiles" in topics else 2}
    except sqlite3.Error:
        return {}


_CURES = {
    "not indexed": "{bag} was not closed by its recorder and has no index; run: rosbag reindex {bag}",
    "File end magic": "{bag} was cut off and lacks its end; run: mcap recover {bag} -o whole.mcap",
    "Profile is not ros2": "{bag} is an MCAP, but not of ROS 2; convert it to a bag of ROS 2 first",
}
"""Next steps after errors of rosbags, by a part of their text."""


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
            except AnyReaderError as error:
                if not any(words in str(error) for words in ("Could not parse", "hash mismatch")):
                    raise
                reader = _reader(paths)
                reader.readers = [_Lenient(part) for part in reader.readers]  # type: ignore[assignment]
                stack.enter_context(reader)
            if reader.is2:
                add_definitions(reader, paths[0], bag)
        yield reader


def _reader(paths: Sequence[Path]) -> AnyReader:
    reader = AnyReader(paths, default_typestore=get_typestore(Stores.EMPTY))
    for part in reader.readers:
        if isinstance(getattr(part, "storage", None), McapReader):
            part.storage = _McapFile(part.path)  # type: ignore[union-attr]
    return reader


class _McapFile(McapReader):
    """Reads files whose summary lacks a part, and unsorted messages without chunks; rosbags does not."""

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


class _Lenient:
    """A reader of a file without those of its definitions that rosbags does not understand.

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
        return connection._replace(digest="")
    except TypesysError:
        nothing = MessageDefinition(MessageDefinitionFormat.NONE, "")
        return connection._replace(digest="", msgdef=nothing)


@contextmanager
def refused_in_one_line(bag: Path) -> Iterator[None]:
    """Around what reads a bag.

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


Message: TypeAlias = tuple[Connection, int, bytes]
"""Connection, time of recording [ns] and serialized content of a message."""
_AHEAD, _FIRST = 8, 64
"""Number of messages that wait for late ones, and of the first ones, which show whether more must wait."""


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
