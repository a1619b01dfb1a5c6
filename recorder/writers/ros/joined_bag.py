"""Joins the bags of several cars: one bag, with the topics of each car below its name, and the same bytes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from heapq import merge
from itertools import repeat
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Writer as Bag1File

from carlaloc_env.core.errors import WriterError
from carlaloc_env.core.files.atomic_files import part_path, remove
from recorder.bags.reader import open_bag
from recorder.writers.ros.mcap_storage import McapBag
from recorder.writers.ros.rosbag1 import bag1_file
from recorder.writers.ros.rosbag2 import STORAGES, VERSION

GLOBAL = ("/clock",)
"""Topics that keep their names: of these, the first bag's messages are written."""


def join_bags(bags: Mapping[str, Path], target: Path, format_name: str) -> Path:
    """Write one bag of several, in the order of time; a message keeps its stamp and its bytes.

    Args:
        bags: A bag of each car, by the name below which its topics go: ``/car1/imu/data``.
        target: The file or folder.
        format_name: Format of them all, a bag's name in `FORMATS`.

    Raises:
        EvaluationError: a bag cannot be read.
        WriterError: the target exists or cannot be written.
    """
    if target.exists():
        raise WriterError(f"{target} exists; choose another folder or delete it first")
    part = part_path(target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        remove(part)
        with ExitStack() as stack:
            readers = {name: stack.enter_context(open_bag(path)) for name, path in bags.items()}
            bag = stack.enter_context(_opened(part, target.name, format_name))
            ids: dict[tuple[str, str], Connection | None] = {}
            rows = [zip(repeat(name), reader.messages()) for name, reader in readers.items()]
            for name, (connection, at_ns, data) in merge(*rows, key=lambda row: row[1][1]):
                if (key := (name, connection.topic)) not in ids:
                    is_known = connection.topic in GLOBAL and name != next(iter(bags))
                    ids[key] = None if is_known else _added(bag, name, connection, readers[name])
                if (to := ids[key]) is not None:
                    bag.write(to, at_ns, data)
        inner = part / target.name
        (inner if inner.exists() else part).rename(target)
    except OSError as error:
        raise WriterError(f"cannot write {target}: {error.strerror or error}") from error
    finally:
        remove(part)
    return target


def _opened(part: Path, name: str, format_name: str) -> Any:
    family, _, kind = format_name.partition("_")
    if family == "rosbag2":
        part.mkdir()
        # The library names files after the folder.
        return McapBag(part / name, version=VERSION, storage_plugin=STORAGES[kind or "mcap"])
    return bag1_file(part, kind or "none")


def _added(bag: Any, name: str, connection: Connection, reader: AnyReader) -> Connection:
    topic = connection.topic if connection.topic in GLOBAL else f"/{name}{connection.topic}"
    option = "latching" if isinstance(bag, Bag1File) else "offered_qos_profiles"
    more = {option: getattr(connection.ext, option)}
    add: Callable[..., Connection] = bag.add_connection
    return add(topic, connection.msgtype, typestore=reader.typestore, **more)
