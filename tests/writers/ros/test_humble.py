"""Metadata of ROS 2 bags, converted by the rules of rosbag2 (yaml-cpp) in Humble, Iron and Jazzy."""

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import yaml
from mcap.reader import make_reader
from rosbags import rosbag2
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from shared_fixtures.readings.bag_samples import drive, rig, write_all

from recorder.writers.ros.rosbag2 import Ros2Encoder, Rosbag2Writer

READS = {"humble": 5, "iron": 7, "jazzy": 9}
"""Newest version of the metadata that a distribution knows; none looks whether a bag's is newer."""
NUMBERS = ("history", "depth", "reliability", "durability", "liveliness")
FOREVER = {"sec": str(2**63 // 10**9), "nsec": str((2**63 - 1) % 10**9)}
"""One of the times that rosbag2 takes for infinite."""


def nodes(file_text: str) -> Any:
    """Nodes of YAML, whose scalars are texts until they are converted, as in yaml-cpp."""
    return yaml.load(file_text, Loader=yaml.BaseLoader)


def text(node: Any) -> str:
    if not isinstance(node, str):
        raise TypeError("bad conversion")
    return node


def quality(node: Any) -> dict[str, Any]:
    """A quality of service, which up to version 8 has numbers for words."""
    return {**node, **{name: int(text(node[name])) for name in NUMBERS}}


def read(bag: Any, reads: int) -> dict[str, list[Any]]:
    """Qualities of service by topic, after every field that a distribution converts."""
    version = int(text(bag["version"]))
    names = ["storage_identifier", "compression_format", "compression_mode"]
    for name in [*names, *(["ros_distro"] if min(version, reads) >= 8 else [])]:
        text(bag[name])
    for part in (bag, *bag["files"]):
        int(text(part["duration"]["nanoseconds"]) + text(part["starting_time"]["nanoseconds_since_epoch"]))
        int(text(part["message_count"]))
    found = {}
    for row in bag["topics_with_message_count"]:
        topic, names = row["topic_metadata"], ["type", "serialization_format"]
        for name in [*names, *(["type_description_hash"] if min(version, reads) >= 7 else [])]:
            text(topic[name])
        offered = topic["offered_qos_profiles"]
        offered = offered if min(version, reads) >= 9 else nodes(text(offered))
        found[text(topic["name"])] = [quality(node) for node in offered]
    return found


def in_the_file(folder: Path, storage: str) -> tuple[str, dict[str, str]]:
    """The copy of the metadata in a bag's file, and the qualities of service by topic."""
    if storage == "mcap":
        with next(folder.glob("*.mcap")).open("rb") as file:
            reader: Any = make_reader(file)
            copies = {record.name: record.metadata for record in reader.iter_metadata()}
            channels = reader.get_summary().channels.values()
        found = {channel.topic: channel.metadata["offered_qos_profiles"] for channel in channels}
        return copies["rosbag2"]["serialized_metadata"], found
    with closing(sqlite3.connect(next(folder.glob("*.db3")))) as base:
        ((copy,),) = base.execute("SELECT metadata FROM metadata")
        return copy, dict(base.execute("SELECT name, offered_qos_profiles FROM topics"))


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_every_distribution_from_humble_on_converts_the_metadata(tmp_path: Path, storage: str) -> None:
    encoder = Ros2Encoder(rig(), streams={sample.sensor for sample in drive()})
    folder = write_all(Rosbag2Writer(tmp_path / "fog", encoder, storage=storage, about={"a": "b"}), drive())
    outer = nodes((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    copy, by_topic = in_the_file(folder, storage)
    found = {topic: [quality(node) for node in nodes(offered)] for topic, offered in by_topic.items()}
    for reads in READS.values():
        assert read(outer, reads) == read(nodes(copy), reads) == found
    assert {"/tf_static", "/imu/data"} <= found.keys()
    for topic, (only,) in found.items():
        # As rmw/types.h counts: keep last, reliable, transient local or volatile, automatic.
        expected = (1, 1, 1, 1, 1) if topic == "/tf_static" else (1, 10, 1, 2, 1)
        assert tuple(only[name] for name in NUMBERS) == expected
        assert only["deadline"] == only["lifespan"] == only["liveliness_lease_duration"] == FOREVER
        assert only["avoid_ros_namespace_conventions"] == "false"
    with AnyReader([folder]) as reader:
        assert {c.topic for c in reader.connections} == found.keys()


def test_humble_refuses_version_9(tmp_path: Path) -> None:
    """The conversions above fail where Humble's do."""
    with rosbag2.Writer(tmp_path / "bag", version=9) as writer:
        store = get_typestore(Stores.ROS2_HUMBLE)
        writer.add_connection("/clock", "rosgraph_msgs/msg/Clock", typestore=store)
    outer = nodes((tmp_path / "bag/metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert read(outer, READS["jazzy"]) == {"/clock": []}
    with pytest.raises(TypeError, match="bad conversion"):
        read(outer, READS["humble"])
