"""ROS 2 bags read back by rosbags and by MCAP's own library: values, definitions, latching, metadata."""

import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from shared_fixtures.readings.bag_samples import batch_of, drive, read, rig, write_all

from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import EVENT
from recorder.writers.base import DEFAULT_EPOCH_NS
from recorder.writers.ros.rosbag1 import Ros1Encoder, Rosbag1Writer
from recorder.writers.ros.rosbag2 import Ros2Encoder, Rosbag2Writer

ABOUT = {"conditions": "weather: FoggyNoon\n", "calibration/extrinsics.yaml": "frames: {}\n"}


def write(path: Path, storage: str) -> Path:
    encoder = Ros2Encoder(rig(), streams={sample.sensor for sample in drive()})
    return write_all(Rosbag2Writer(path, encoder, storage=storage, about=ABOUT), drive())


@pytest.fixture(scope="module", params=["mcap", "sqlite3"])
def bag(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same drive in both storages."""
    return write(tmp_path_factory.mktemp("bags") / "fog", request.param)


@pytest.fixture(scope="module")
def mcap(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("bags") / "fog", "mcap")


def plain(message: Any) -> Any:
    """A message as nested values, without ROS 1's counter."""
    if isinstance(message, np.ndarray):
        return (message.dtype.str, message.tobytes())
    if isinstance(message, list):
        return [plain(item) for item in message]
    fields = getattr(message, "__dataclass_fields__", None)
    if fields is None:
        return message
    return {n.lower(): plain(getattr(message, n)) for n in fields if n != "seq" and not n.startswith("__")}


def test_messages_are_those_of_the_ros1_bag(bag: Path, tmp_path: Path) -> None:
    encoder = Ros1Encoder(rig(), streams={sample.sensor for sample in drive()})
    one = write_all(Rosbag1Writer(tmp_path / "one.bag", encoder), drive())
    (types1, messages1), (types2, messages2) = read(one), read(bag)
    assert {topic: kind for topic, (kind, _) in types1.items()} == {t: k for t, (k, _) in types2.items()}
    for topic, rows in messages1.items():
        assert [at for at, _ in rows] == [at for at, _ in messages2[topic]], topic
        assert [plain(m) for _, m in rows] == [plain(m) for _, m in messages2[topic]], topic


def test_metadata_counts(bag: Path) -> None:
    about = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    _, messages = read(bag)
    topics = about["topics_with_message_count"]
    counts = {row["topic_metadata"]["name"]: row["message_count"] for row in topics}
    assert counts == {topic: len(rows) for topic, rows in messages.items()}
    assert about["message_count"] == sum(counts.values())
    assert about["starting_time"]["nanoseconds_since_epoch"] == DEFAULT_EPOCH_NS
    assert all((bag / name).is_file() for name in about["relative_file_paths"])
    assert {path.name for path in bag.iterdir()} == {"metadata.yaml", *about["relative_file_paths"]}
    assert about["custom_data"] == ABOUT


def test_mcap_is_whole_by_its_own_library(mcap: Path) -> None:
    with next(mcap.glob("*.mcap")).open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert reader.get_header().profile == "ros2"
        assert {chunk.compression for chunk in summary.chunk_indexes} == {"zstd"}
        rows = list(reader.iter_messages())
        assert len(rows) == summary.statistics.message_count  # type: ignore[union-attr]
        for schema, channel, _ in rows:
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            assert yaml.safe_load(channel.metadata["offered_qos_profiles"])
        texts = {schema.name: schema.data.decode() for schema, _, _ in rows if schema is not None}
    # Definitions inside: with those of the parts, each after a line of 80 equal signs.
    assert "=" * 80 + "\nMSG: std_msgs/Header" in texts["sensor_msgs/msg/Imu"]


def test_sqlite_is_whole_by_its_own_library(tmp_path: Path) -> None:
    bag = write(tmp_path / "fog", "sqlite3")
    with sqlite3.connect(next(bag.glob("*.db3"))) as base:
        assert base.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        topics = dict(base.execute("SELECT name, type FROM topics"))
    assert topics["/imu/data"] == "sensor_msgs/msg/Imu"


def test_events_survive(tmp_path: Path) -> None:
    events = np.zeros(5, EVENT)
    events["t"], events["x"], events["y"], events["p"] = np.arange(5) * 1000, np.arange(5), 7, [0, 1, 0, 1, 1]
    sample = batch_of(events, 10_000, (32, 24), 10_000)
    writer = Rosbag2Writer(tmp_path / "events", Ros2Encoder(rig(), profile="full"))
    _, messages = read(write_all(writer, [sample]))
    ((_, message),) = messages["/camera/left/events"]
    assert [(e.x, e.y, e.polarity) for e in message.events] == [
        (int(row["x"]), int(row["y"]), bool(row["p"])) for row in events
    ]


def test_unknown_storage_names_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(WriterError, match="did you mean 'sqlite3'"):
        Rosbag2Writer(tmp_path / "bag", Ros2Encoder(rig()), storage="sqlite")
