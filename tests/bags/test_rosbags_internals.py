"""Internals of rosbags that we replace: their names, and gaps that a release may close (then ours can go)."""

import inspect
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap.writer import IndexType
from rosbags import rosbag1, rosbag2
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.typesys import Stores, get_typestore
from shared_fixtures.readings import dressed_clouds as clouds
from shared_fixtures.readings.dressed_clouds import TOPIC, Dressing, dressed

from recorder.bags.reader import _McapFile
from recorder.writers.ros.mcap_storage import McapStorage

JAZZY = get_typestore(Stores.ROS2_JAZZY)


def written(path: Path, stamps: tuple[int, ...] = (1, 2), definition: str = "", **how: Any) -> Path:
    """An MCAP file of clouds with some parts of the index, beside a topic with a definition."""
    with path.open("wb") as file:
        writer = clouds.McapWriter(file, **how)
        writer.start(profile="ros2", library="test")
        data, _ = JAZZY.generate_msgdef(clouds.CLOUD, ros_version=2)
        schema = writer.register_schema(name=clouds.CLOUD, encoding="ros2msg", data=data.encode())
        channel = writer.register_channel(topic=TOPIC, message_encoding="cdr", schema_id=schema)
        if definition:
            schema = writer.register_schema(name="a/srv/B", encoding="ros2msg", data=definition.encode())
            writer.register_channel(topic="/b", message_encoding="cdr", schema_id=schema)
        raw = bytes(JAZZY.serialize_cdr(dressed(JAZZY, 0, Dressing()), clouds.CLOUD))
        for stamp in stamps:
            writer.add_message(channel, log_time=stamp, publish_time=0, data=raw)
        writer.finish()
    return path


def count_by_rosbags(path: Path) -> int:
    """Number of messages that rosbags finds by itself."""
    with AnyReader([path]) as reader:
        return len(list(reader.messages()))


def test_names_of_the_reader(tmp_path: Path) -> None:
    for name in ("read_index", "messages"):
        ours, theirs = (inspect.signature(getattr(kind, name)) for kind in (_McapFile, McapReader))
        assert list(ours.parameters) == list(theirs.parameters)
    path = written(tmp_path / "a.mcap")
    part: Any = AnyReader([path]).readers[0]
    assert type(part.storage) is McapReader
    with part:
        assert len(part.storage.chunks) == len(part.storage.schemas) == len(part.storage.channels) == 1
        assert list(part.storage.chunks[0].channel_count.values()) == [2]
        assert part.storage.statistics.message_count == 2
        assert {"digest", "msgdef"} <= set(part.connections[0]._fields)
        assert len(list(part.storage.messages_scan(part.connections))) == 2


def test_names_of_the_writers(tmp_path: Path) -> None:
    theirs = rosbag2.Writer.STORAGE_PLUGINS[StoragePlugin.MCAP]
    for name in ("add_msgtype", "add_connection", "write", "close", "abort"):
        ours = inspect.signature(getattr(McapStorage, name))
        assert list(ours.parameters) == list(inspect.signature(getattr(theirs, name)).parameters)
    bag = rosbag1.Writer(tmp_path / "a.bag")
    assert bag.bio is None
    assert bag.compressor(b"data") == b"data"


@pytest.mark.parametrize(
    ("how", "count"),
    [
        ({}, 2),
        ({"repeat_channels": False}, 0),
        ({"index_types": IndexType.CHUNK}, 0),
    ],
    ids=str,
)
def test_summaries_that_lack_a_part(tmp_path: Path, how: dict[str, Any], count: int) -> None:
    assert count_by_rosbags(written(tmp_path / "a.mcap", **how)) == count


def test_what_it_does_not_read_or_write(tmp_path: Path) -> None:
    with pytest.raises(Exception, match="not in timestamp order"):
        count_by_rosbags(written(tmp_path / "a.mcap", (2, 1), use_chunking=False))
    with pytest.raises(AnyReaderError, match="Could not parse"):
        count_by_rosbags(written(tmp_path / "b.mcap", definition="int64 a\n---\nint64 b\n"))
    with rosbag2.Writer(tmp_path / "c", version=8, storage_plugin=StoragePlugin.MCAP) as bag:
        link = bag.add_connection(TOPIC, clouds.CLOUD, typestore=JAZZY)
        bag.write(link, 1, JAZZY.serialize_cdr(dressed(JAZZY, 0, Dressing()), clouds.CLOUD))
    with (tmp_path / "c" / "c.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert [chunk.compression for chunk in summary.chunk_indexes] == [""]
