"""Opening a bag of any kind."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from carlaloc_env.core.errors import CarlaLocError, EvaluationError
from recorder.bags.files import files_of_bag
from recorder.bags.type_stores import add_definitions

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
    return AnyReader(paths, default_typestore=get_typestore(Stores.EMPTY))


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
