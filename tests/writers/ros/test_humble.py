"""Metadata of ROS 2 bags, read by the rules of rosbag2's conversions (yaml-cpp) in Humble, Iron and Jazzy."""

import re
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
"""Newest version of the metadata that a distribution knows; none refuses a newer one by its number."""
RELIABLE, KEEP_LAST, AUTOMATIC = 1, 1, 1
TRANSIENT_LOCAL, VOLATILE = 1, 2
FOREVER = (0x7FFFFFFFFFFFFFFF // 10**9, 0x7FFFFFFFFFFFFFFF % 10**9)
"""One of the times that rosbag2 takes for infinite (rmw's enumerations and times: rmw/types.h)."""


class BadConversion(Exception):
    """A node is missing, or of another kind than its reader wants."""


class Node:
    """A node of YAML whose scalars have no type until they are converted, as in yaml-cpp."""

    def __init__(self, node: yaml.Node | None) -> None:
        self.node = node

    def __getitem__(self, key: str) -> "Node":
        if not isinstance(self.node, yaml.MappingNode):
            raise BadConversion(key)
        return Node(next((value for name, value in self.node.value if name.value == key), None))

    def items(self) -> list["Node"]:
        if not isinstance(self.node, yaml.SequenceNode):
            raise BadConversion("no sequence")
        return [Node(item) for item in self.node.value]

    def text(self) -> str:
        if not isinstance(self.node, yaml.ScalarNode):
            raise BadConversion("no scalar")
        return str(self.node.value)

    def whole(self) -> int:
        if not re.fullmatch(r"\d+", self.text()):
            raise BadConversion(f"no number: {self.text()}")
        return int(self.text())

    def boolean(self) -> bool:
        if self.text().lower() not in ("true", "false", "yes", "no", "on", "off", "y", "n"):
            raise BadConversion(f"no truth value: {self.text()}")
        return self.text().lower() in ("true", "yes", "on", "y")


def qualities_of(topic: Node, version: int, reads: int) -> Node:
    """Qualities of service of a topic: in a text up to version 8, and wherever version 9 is unknown."""
    field = topic["offered_qos_profiles"]
    return field if version >= 9 and reads >= 9 else Node(yaml.compose(field.text()))


def quality(node: Node) -> dict[str, Any]:
    """A quality of service by numbers, as up to version 8."""
    found: dict[str, Any] = {
        name: node[name].whole() for name in ("history", "depth", "reliability", "durability", "liveliness")
    }
    for name in ("deadline", "lifespan", "liveliness_lease_duration"):
        found[name] = (node[name]["sec"].whole(), node[name]["nsec"].whole())
    return {**found, "hidden": node["avoid_ros_namespace_conventions"].boolean()}


def read(bag: Node, reads: int) -> dict[str, list[dict[str, Any]]]:
    """Qualities of service by topic, after every field that a distribution converts."""
    version = bag["version"].whole()
    bag["storage_identifier"].text()
    for part in (bag, *(bag["files"].items() if version >= 5 else ())):
        part["duration"]["nanoseconds"].whole()
        part["starting_time"]["nanoseconds_since_epoch"].whole()
        part["message_count"].whole()
    for name in ("compression_format", "compression_mode"):
        bag[name].text()
    assert [path.text() for path in bag["relative_file_paths"].items()]
    if version >= 8 and reads >= 8:
        bag["ros_distro"].text()
    found = {}
    for row in bag["topics_with_message_count"].items():
        topic = row["topic_metadata"]
        row["message_count"].whole()
        for name in ("name", "type", "serialization_format"):
            topic[name].text()
        if version >= 7 and reads >= 7:
            topic["type_description_hash"].text()
        found[topic["name"].text()] = [quality(q) for q in qualities_of(topic, version, reads).items()]
    return found


def in_the_file(folder: Path, storage: str) -> tuple[str, dict[str, str]]:
    """The copy of the metadata in a bag's file, and the qualities of service by topic."""
    if storage == "mcap":
        with next(folder.glob("*.mcap")).open("rb") as file:
            reader = make_reader(file)
            copies = {record.name: record.metadata for record in reader.iter_metadata()}
            summary = reader.get_summary()
            assert summary is not None
            copy = copies["rosbag2"]["serialized_metadata"]
            return copy, {c.topic: c.metadata["offered_qos_profiles"] for c in summary.channels.values()}
    with closing(sqlite3.connect(next(folder.glob("*.db3")))) as base:
        ((copy,),) = base.execute("SELECT metadata FROM metadata")
        return copy, dict(base.execute("SELECT name, offered_qos_profiles FROM topics"))


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_every_distribution_from_humble_on_converts_the_metadata(tmp_path: Path, storage: str) -> None:
    encoder = Ros2Encoder(rig(), streams={sample.sensor for sample in drive()})
    folder = write_all(Rosbag2Writer(tmp_path / "fog", encoder, storage=storage, about={"a": "b"}), drive())
    outer = Node(yaml.compose((folder / "metadata.yaml").read_text()))["rosbag2_bagfile_information"]
    copy, by_topic = in_the_file(folder, storage)
    for reads in READS.values():
        found = read(outer, reads)
        assert read(Node(yaml.compose(copy)), reads) == found
    for topic, text in by_topic.items():
        assert [quality(node) for node in Node(yaml.compose(text)).items()] == found[topic]
    for topic, (only,) in found.items():
        latched = topic == "/tf_static"
        assert only == {
            "history": KEEP_LAST, "depth": 1 if latched else 10, "reliability": RELIABLE,
            "durability": TRANSIENT_LOCAL if latched else VOLATILE, "liveliness": AUTOMATIC, "hidden": False,
            **dict.fromkeys(("deadline", "lifespan", "liveliness_lease_duration"), FOREVER),
        }  # fmt: skip
    assert {"/tf_static", "/imu/data"} <= found.keys()
    with AnyReader([folder]) as reader:
        assert {c.topic for c in reader.connections} == found.keys()


def test_humble_refuses_version_9(tmp_path: Path) -> None:
    """The parser above fails where Humble does."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    with rosbag2.Writer(tmp_path / "bag", version=9) as writer:
        writer.add_connection("/clock", "rosgraph_msgs/msg/Clock", typestore=store)
    outer = Node(yaml.compose((tmp_path / "bag/metadata.yaml").read_text()))["rosbag2_bagfile_information"]
    assert read(outer, READS["jazzy"]) == {"/clock": []}
    with pytest.raises(BadConversion, match="no scalar"):
        read(outer, READS["humble"])
