"""What opens as a bag: every kind of file, folder and distribution, and one line for the rest."""

import functools
import gzip
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from mcap.writer import IndexType
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore
from shared_fixtures.processes.external_programs import SYSTEM_PYTHON, missing_ros
from shared_fixtures.readings import dressed_clouds as clouds
from shared_fixtures.readings.dressed_clouds import TOPIC, Dressing, dressed

from carlaloc_env.core.errors import EvaluationError
from recorder.bags.reader import open_bag
from recorder.dataset.bag_messages import topics_in
from recorder.dataset.scans import read_scans
from recorder.writers.base import DEFAULT_EPOCH_NS

JAZZY = get_typestore(Stores.ROS2_JAZZY)
ROS2 = [store for store in Stores if store.name.startswith("ROS2_")]


def messages(first: int, count: int = 2, store: Any = JAZZY) -> dict[str, list[Any]]:
    """Clouds of the sweeps from a number on, by which bags are told apart."""
    return {TOPIC: [dressed(store, first + k, Dressing()) for k in range(count)]}


def sweeps_in(bag: Path, topic: str | None = None) -> list[float]:
    """Numbers of the sweeps in a bag."""
    return [(scan.stamp_ns - DEFAULT_EPOCH_NS) / clouds.SWEEP_NS for _, scan in read_scans(bag, topic)]


def mcap(path: Path, first: int, **how: str) -> Path:
    return clouds.write_ros2(path, JAZZY, messages(first), **how)


@pytest.mark.parametrize("storage", ["MCAP", "SQLITE3"])
def test_the_file_that_was_named_is_read_not_its_neighbour(tmp_path: Path, storage: str) -> None:
    one, other = mcap(tmp_path / "one", 1, storage=storage), mcap(tmp_path / "other", 5, storage=storage)
    (file,) = other.glob("other.*")
    beside = Path(shutil.copy(file, one))
    assert sweeps_in(beside) == [5, 6]
    assert sweeps_in(one) == [1, 2]
    assert sweeps_in(one / "metadata.yaml") == [1, 2]
    assert sweeps_in(next(one.glob("one.*"))) == [1, 2]


@pytest.mark.parametrize("store", ROS2, ids=lambda store: store.name)
def test_bags_of_every_distribution_are_read_without_definitions(tmp_path: Path, store: Stores) -> None:
    types = get_typestore(store)
    found = messages(3, store=types)
    assert sweeps_in(clouds.write_bare_mcap(tmp_path / "a.mcap", types, found, store.value[5:])) == [3, 4]
    folder = clouds.write_ros2(tmp_path / "b", types, found, storage="SQLITE3")
    assert sweeps_in(clouds.without_definitions(folder, store.value[5:], 4)) == [3, 4]


@pytest.mark.parametrize(
    "how", [{}, {"repeat_schemas": False, "repeat_channels": False}, {"use_chunking": False}]
)
@pytest.mark.parametrize(
    ("encoding", "schema", "data"),
    [
        ("json", "jsonschema", b"{}"),
        ("protobuf", "protobuf", b"\x0a\xff\xfe"),
        ("cdr", "ros2idl", b"module a { struct"),
        ("cdr", "ros2msg", b"no definition"),
        ("json", "", b""),
    ],
)
def test_topics_that_are_not_of_ros_hinder_none_beside_them(
    encoding: str, schema: str, data: bytes, how: dict[str, bool], tmp_path: Path
) -> None:
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = clouds.McapWriter(file, **how)
        writer.start(profile="ros2", library="test")
        other = writer.register_schema("a/msg/Other", schema, data) if schema else 0
        others = writer.register_channel("/other", encoding, other)
        ours = writer.register_channel(TOPIC, "cdr", writer.register_schema(clouds.CLOUD, "", b""))
        for at_ns, _, message in clouds.stamped(messages(3)):
            writer.add_message(others, log_time=at_ns, data=b"{}", publish_time=at_ns)
            raw = bytes(JAZZY.serialize_cdr(message, clouds.CLOUD))
            writer.add_message(ours, log_time=at_ns, data=raw, publish_time=at_ns)
        writer.finish()
    assert sweeps_in(tmp_path / "a.mcap") == [3, 4]


def test_folders_without_metadata_are_the_bag_in_them(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    for k in (0, 1):
        shutil.copy(mcap(tmp_path / f"m{k}", 2 * k) / f"m{k}.mcap", folder / f"run_{k}.mcap")
    assert sweeps_in(folder) == [0, 1, 2, 3]
    assert "parts of one bag" in caplog.messages[0]
    (folder / "run_1.mcap").unlink()
    assert sweeps_in(folder) == [0, 1]
    assert sweeps_in(tmp_path / "m1") == [2, 3]


def test_several_bags_are_named(tmp_path: Path) -> None:
    for name in ("a", "b"):
        mcap(tmp_path / name, 0)
    with pytest.raises(EvaluationError, match="holds 2 bags; give one of them: a, b"):
        sweeps_in(tmp_path)
    shutil.move(tmp_path / "a" / "a.mcap", tmp_path / "run_1.mcap")
    shutil.move(tmp_path / "b" / "b.mcap", tmp_path / "run_2.mcap")
    with pytest.raises(EvaluationError, match=r"give one of them: run_1\.mcap, run_2\.mcap"):
        sweeps_in(tmp_path)
    with pytest.raises(EvaluationError, match=r"metadata\.yaml names a\.mcap, not there"):
        sweeps_in(tmp_path / "a")


def test_what_a_file_holds_decides_not_its_name(tmp_path: Path) -> None:
    ros1 = get_typestore(Stores.ROS1_NOETIC)
    bag = clouds.write_ros1(tmp_path / "run.bag", ros1, messages(7, store=ros1))
    assert sweeps_in(bag.rename(tmp_path / "run.mcap")) == [7, 8]
    file = mcap(tmp_path / "run.d", 1) / "run.d.mcap"
    assert sweeps_in(file.rename(tmp_path / "run.bag")) == [1, 2]
    assert sweeps_in(mcap(tmp_path / "folder.bag", 4)) == [4, 5]


SHUFFLED = [3, 0, 5, 1, 4, 2]
"""Order in which sweeps are recorded."""


@pytest.mark.parametrize("written", [range(6), SHUFFLED], ids=["sorted", "unsorted"])
@pytest.mark.parametrize(
    "how",
    [
        {"repeat_channels": False},
        {"repeat_schemas": False},
        {"index_types": IndexType.CHUNK},
        {"index_types": IndexType.CHUNK, "use_statistics": False},
        {"index_types": IndexType.CHUNK, "repeat_channels": False, "repeat_schemas": False},
        {"index_types": IndexType.NONE},
        {"use_chunking": False, "use_statistics": False},
    ],
    ids=str,
)
def test_an_mcap_with_any_index_is_read_in_the_order_of_stamps(
    tmp_path: Path, how: dict[str, Any], written: Sequence[int]
) -> None:
    """Sweeps are recorded as `SHUFFLED`; the file has them in that order, or shuffled again."""
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = clouds.McapWriter(file, chunk_size=100_000, **how)
        writer.start(profile="ros2", library="test")
        schema = writer.register_schema(name=clouds.CLOUD, encoding="", data=b"")
        channel = writer.register_channel(topic=TOPIC, message_encoding="cdr", schema_id=schema)
        for place in written:
            raw = bytes(JAZZY.serialize_cdr(messages(SHUFFLED[place], 1)[TOPIC][0], clouds.CLOUD))
            writer.add_message(channel, log_time=100 + place, publish_time=0, data=raw)
        writer.finish()
    assert sweeps_in(tmp_path / "a.mcap") == list(range(6))
    assert topics_in(tmp_path / "a.mcap") == {TOPIC: 6}


@pytest.mark.parametrize("kind", ["ROS 1", "little-endian", "big-endian"])
@pytest.mark.parametrize("order", [[*range(64), *range(71, 63, -1)], [9, *range(9), *range(10, 70)]])
def test_late_clouds_come_in_their_turn(tmp_path: Path, order: list[int], kind: str) -> None:
    """Seven places late behind 64 that are in order, and nine places too early at the beginning."""
    bag: Any = rosbag1.Writer(tmp_path / "a.bag")
    store, pack = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS1_NOETIC).serialize_ros1
    if kind != "ROS 1":
        bag, store = rosbag2.Writer(tmp_path / "a.bag", version=8), JAZZY
        pack = functools.partial(store.serialize_cdr, little_endian=kind == "little-endian")
    (small,) = messages(0, 1, store)[TOPIC]
    small.width, small.row_step, small.data = 4, 4 * small.point_step, small.data[: 4 * small.point_step]
    with bag:
        link = bag.add_connection(TOPIC, clouds.CLOUD, typestore=store)
        for at_ns, number in enumerate(order):
            small.header.stamp.sec = 1000 + number
            bag.write(link, at_ns, pack(small, clouds.CLOUD))
    stamps_s = [scan.stamp_ns // 10**9 - 1000 for _, scan in read_scans(tmp_path / "a.bag", topic=TOPIC)]
    assert stamps_s == sorted(order)


def test_packed_files_are_read_or_named(tmp_path: Path) -> None:
    folder = mcap(tmp_path / "run", 3, storage="SQLITE3", compression="FILE")
    assert sweeps_in(folder) == sweeps_in(folder / "run.db3.zstd") == [3, 4]
    folder = mcap(tmp_path / "single", 1, storage="SQLITE3", compression="MESSAGE")
    assert sweeps_in(folder) == sweeps_in(folder / "single.db3") == [1, 2]
    bare = mcap(tmp_path / "bare", 6) / "bare.mcap"
    packed = bare.with_suffix(".mcap.zstd")
    packed.write_bytes(zstandard.compress(bare.read_bytes()))
    assert sweeps_in(packed) == [6, 7]
    packed.write_bytes(packed.read_bytes()[:-5000])
    with pytest.raises(EvaluationError):
        sweeps_in(packed)
    packed = bare.with_suffix(".mcap.gz")
    packed.write_bytes(gzip.compress(bare.read_bytes()))
    with pytest.raises(EvaluationError, match="packed by gzip; unpack it"):
        sweeps_in(packed)


def test_recordings_that_were_not_closed_are_named_with_their_cure(tmp_path: Path) -> None:
    file = mcap(tmp_path / "run", 0) / "run.mcap"
    file.write_bytes(file.read_bytes()[:-100])
    with pytest.raises(EvaluationError, match=r"was cut off .* mcap recover"):
        sweeps_in(file)
    base = mcap(tmp_path / "base", 0, storage="SQLITE3") / "base.db3"
    base.with_name("base.db3-wal").write_bytes(b"0")
    with pytest.raises(EvaluationError, match=r"not closed .* wal_checkpoint"):
        sweeps_in(base)


def test_definitions_that_rosbags_does_not_understand_keep_nobody_from_the_rest(tmp_path: Path) -> None:
    """Jazzy records calls of services, with definitions that hold a line of dashes."""
    path = tmp_path / "services.mcap"
    with path.open("wb") as file:
        writer = clouds.McapWriter(file)
        writer.start(profile="ros2", library="rosbag2")
        definition = b"=" * 80 + b"\nMSG: a/srv/Add_Event\nint64 a\n---\nint64 b\n"
        schema = writer.register_schema(name="a/srv/Add_Event", encoding="ros2msg", data=definition)
        writer.register_channel(topic="/add/_service_event", message_encoding="cdr", schema_id=schema)
        schema = writer.register_schema(name=clouds.CLOUD, encoding="", data=b"")
        channel = writer.register_channel(topic=TOPIC, message_encoding="cdr", schema_id=schema)
        raw = bytes(JAZZY.serialize_cdr(messages(9)[TOPIC][0], clouds.CLOUD))
        writer.add_message(channel, log_time=1, publish_time=1, data=raw)
        writer.add_metadata("rosbag2", {"ROS_DISTRO": "jazzy"})
        writer.finish()
    assert sweeps_in(path) == [9]


@pytest.mark.parametrize("name", ["", "missing.bag", "note.bag"])
def test_what_is_no_bag_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / "note.bag").write_text("no bag")
    with (
        pytest.raises(EvaluationError, match=r"no such bag|no ROS bag, or a damaged one"),
        open_bag(tmp_path / name),
    ):
        pass


DEBIAN = """
import os, sys, rospy, rosbag
from sensor_msgs.msg import PointCloud2, PointField
folder, begin_s = sys.argv[1], float(sys.argv[2])
points = open(folder + "/points", "rb").read()
fields = [PointField(n, 4 * k, 7, 1) for k, n in enumerate("xyz")] + [PointField("time", 12, 7, 1)]
for name, packing in (("none", "none"), ("bz2", "bz2"), ("lz4", "lz4"), ("open", "none")):
    bag = rosbag.Bag(folder + "/" + name + ".bag", "w", compression=packing)
    for k in range(3):
        cloud = PointCloud2(height=1, width=len(points) // 16, fields=fields, point_step=16, data=points)
        cloud.row_step = len(points)
        cloud.header.stamp = rospy.Time.from_sec(begin_s + 0.1 * k)
        bag.write("/velodyne_points", cloud, cloud.header.stamp)
    if name == "open":
        bag.flush()
        os._exit(0)
    bag.close()
"""


def test_bags_of_debian_ros_are_read(tmp_path: Path) -> None:
    if missing := missing_ros():
        pytest.skip(missing)
    cloud = clouds.sweep(0)
    points = np.column_stack([cloud.points_xyz_m, cloud.offset_ns * 1e-9]).astype("<f4")
    (tmp_path / "points").write_bytes(points.tobytes())
    begin_s = 1_700_000_000.25
    subprocess.run([SYSTEM_PYTHON, "-c", DEBIAN, str(tmp_path), str(begin_s)], check=True)
    for name in ("none", "bz2", "lz4"):
        found = [scan for _, scan in read_scans(tmp_path / f"{name}.bag")]
        stamps_s = [scan.stamp_ns * 1e-9 for scan in found]
        np.testing.assert_allclose(stamps_s, begin_s + 0.1 * np.arange(3), rtol=0, atol=1e-6)
        np.testing.assert_array_equal(found[0].points_xyz_m, points[:, :3])
        np.testing.assert_array_equal(found[0].time_s, points[:, 3])
    with pytest.raises(EvaluationError, match=r"not closed .* rosbag reindex"):
        list(read_scans(tmp_path / "open.bag"))
