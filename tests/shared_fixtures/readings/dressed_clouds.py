"""The same clouds in the dressings of other people's drivers, written into bags of every kind."""

import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from mcap.writer import Writer as McapWriter
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from shared_fixtures.readings.slam_dataset import SWEEP_NS, sweep

from recorder.writers.base import DEFAULT_EPOCH_NS

TOPIC, CLOUD, LIVOX = "/lidar/points", "sensor_msgs/msg/PointCloud2", "livox_ros_driver2/msg/CustomMsg"
SWEEPS = 12
_NUMBERS = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
_LIVOX_POINT = (
    "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\nuint8 tag\nuint8 line\n"
)
_LIVOX_CLOUD = (
    "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\n"
    "livox_ros_driver2/CustomPoint[] points\n"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Dressing:
    """How a driver puts points into a message."""

    ring: tuple[str, str] | None = ("ring", "u2")
    """Name and NumPy type."""
    time: tuple[str, str] | None = ("time", "f4")
    """Name and type."""
    unit_ns: int = 1_000_000_000
    """Unit of the times."""
    header_ns: int = 0
    """The header's stamp after the first point."""
    zero_ns: int | None = None
    """Zero of the times in Unix time; None: the header's stamp."""
    order: str = "<"
    height: int = 1
    row_pad: int = 0
    """Bytes behind each row."""
    no_return: bool = False
    """Whether every fifth point is NaN or zero, beside those that were measured."""


def dressed(store: Any, number: int, dressing: Dressing) -> Any:
    """A sweep as a `sensor_msgs/PointCloud2`."""
    cloud = sweep(number * SWEEP_NS)
    begin_ns = DEFAULT_EPOCH_NS + number * SWEEP_NS
    header_ns = begin_ns + dressing.header_ns
    zero_ns = header_ns if dressing.zero_ns is None else dressing.zero_ns
    columns: list[tuple[str, str, Any]] = [
        (axis, "f4", cloud.points_xyz_m[:, k]) for k, axis in enumerate("xyz")
    ]
    columns.append(("intensity", "f4", cloud.intensity))
    if dressing.ring is not None:
        columns.append((*dressing.ring, cloud.ring))
    if dressing.time is not None:
        raw = cloud.offset_ns.astype(np.int64) + (begin_ns - zero_ns)
        whole = dressing.time[1][0] in "iu"
        columns.append((*dressing.time, raw // dressing.unit_ns if whole else raw / dressing.unit_ns))
    layout = [(name, dressing.order + code) for name, code, _ in columns]
    rows = np.zeros(len(cloud.points_xyz_m), layout)
    for name, _, values in columns:
        rows[name] = values
    if dressing.no_return:
        rows = np.repeat(rows, np.where(np.arange(len(rows)) % 5, 1, 3))
        empty = np.flatnonzero(np.concatenate([[False], rows[1:] == rows[:-1]]))
        for axis in "xyz":
            rows[axis][empty[::2]], rows[axis][empty[1::2]] = np.nan, 0.0
    return message_of(store, rows, header_ns, dressing)


def message_of(store: Any, rows: Any, header_ns: int, dressing: Dressing) -> Any:
    """Rows as a message; the number of points is cut to whole rows."""
    kinds, kind = store.types, rows.dtype
    width = len(rows) // dressing.height
    data = rows[: width * dressing.height].view(np.uint8).reshape(dressing.height, -1)
    data = np.pad(data, ((0, 0), (0, dressing.row_pad)), constant_values=255)
    fields = [
        kinds["sensor_msgs/msg/PointField"](
            name=name, offset=int(kind.fields[name][1]), datatype=_NUMBERS[kind[name].str[1:]], count=1
        )
        for name in kind.names
        if name != "pad"
    ]
    return kinds[CLOUD](
        header=_header(store, header_ns), height=dressing.height, width=width, fields=fields,
        is_bigendian=dressing.order == ">", point_step=kind.itemsize, row_step=data.shape[1],
        data=data.reshape(-1), is_dense=not dressing.no_return,
    )  # fmt: skip


def livox(store: Any, number: int) -> Any:
    """A sweep as Livox's `CustomMsg`; the store has to know it (`with_livox`)."""
    cloud, kinds = sweep(number * SWEEP_NS), store.types
    begin_ns = DEFAULT_EPOCH_NS + number * SWEEP_NS
    point = kinds["livox_ros_driver2/msg/CustomPoint"]
    rows = zip(cloud.offset_ns.tolist(), cloud.points_xyz_m.tolist(), cloud.ring.tolist(), strict=True)
    return kinds[LIVOX](
        header=_header(store, begin_ns),
        timebase=begin_ns,
        point_num=len(cloud.ring),
        lidar_id=0,
        rsvd=np.zeros(3, np.uint8),
        points=[
            point(offset_time=t, x=x, y=y, z=z, reflectivity=9, tag=0, line=line)
            for t, (x, y, z), line in rows
        ],
    )


def with_livox(name: Stores) -> Any:
    """A type store that knows Livox's messages."""
    store = get_typestore(name)
    store.register(get_types_from_msg(_LIVOX_POINT, "livox_ros_driver2/msg/CustomPoint"))
    store.register(get_types_from_msg(_LIVOX_CLOUD, LIVOX))
    return store


def _header(store: Any, stamp_ns: int) -> Any:
    time = store.types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    words = {"seq": 0} if "seq" in store.types["std_msgs/msg/Header"].__dataclass_fields__ else {}
    return store.types["std_msgs/msg/Header"](**words, stamp=time, frame_id="lidar")


def stamped(messages: Mapping[str, list[Any]]) -> Iterator[tuple[int, str, Any]]:
    """Messages by topic, in the order of the times at which they are recorded: as sweeps end."""
    rows = [(_stamp_ns(m), topic, m) for topic, found in messages.items() for m in found]
    for stamp_ns, topic, message in sorted(rows, key=lambda row: row[:2]):
        yield stamp_ns + SWEEP_NS, topic, message


def _stamp_ns(message: Any) -> int:
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def write_ros1(path: Path, store: Any, messages: Mapping[str, list[Any]]) -> Path:
    """A file of ROS 1."""
    with rosbag1.Writer(path) as writer:
        connections = {
            topic: writer.add_connection(topic, found[0].__msgtype__, typestore=store)
            for topic, found in messages.items()
        }
        for at_ns, topic, message in stamped(messages):
            raw = store.serialize_ros1(message, message.__msgtype__)
            writer.write(connections[topic], at_ns, raw)
    return path


def write_ros2(
    folder: Path,
    store: Any,
    messages: Mapping[str, list[Any]],
    *,
    storage: str = "MCAP",
    compression: str = "NONE",
) -> Path:
    """A folder of ROS 2, with definitions."""
    plugin = rosbag2.StoragePlugin[storage]
    writer = rosbag2.Writer(folder, version=9, storage_plugin=plugin)
    writer.set_compression(rosbag2.CompressionMode[compression], rosbag2.CompressionFormat.ZSTD)
    with writer:
        connections = {
            topic: writer.add_connection(topic, found[0].__msgtype__, typestore=store)
            for topic, found in messages.items()
        }
        for at_ns, topic, message in stamped(messages):
            writer.write(connections[topic], at_ns, store.serialize_cdr(message, message.__msgtype__))
    return folder


def without_definitions(folder: Path, distribution: str, version: int) -> Path:
    """Make a SQLite bag one of an older distribution, which wrote no definitions.

    Args:
        folder: The bag.
        distribution: Its name, in the table ``schema`` if it is Humble's.
        version: Version of ``metadata.yaml``.
    """
    (file,) = folder.glob("*.db3")
    with closing(sqlite3.connect(file)) as base:
        base.executescript(
            "DROP TABLE message_definitions; DROP TABLE metadata; DROP TABLE schema;"
            "ALTER TABLE topics DROP COLUMN type_description_hash;"
        )
        if distribution == "humble":
            base.executescript(
                "CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);"
                "INSERT INTO schema VALUES (3, 'humble');"
            )
        base.commit()
    metadata = folder / "metadata.yaml"
    described = yaml.safe_load(metadata.read_text())
    bag = described["rosbag2_bagfile_information"]
    bag["version"] = version
    for name in ("ros_distro", "custom_data"):
        bag.pop(name, None)
    for topic in bag["topics_with_message_count"]:
        topic["topic_metadata"].pop("type_description_hash", None)
        topic["topic_metadata"]["offered_qos_profiles"] = ""
    metadata.write_text(yaml.safe_dump(described))
    return folder


def write_bare_mcap(
    path: Path, store: Any, messages: Mapping[str, list[Any]], distribution: str = ""
) -> Path:
    """An MCAP of ROS 2 whose schemas are empty, as its recorder writes them where it finds no definition."""
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start(profile="ros2", library="rosbag2")
        channels = {}
        for topic, found in messages.items():
            name = found[0].__msgtype__
            schema = writer.register_schema(name=name, encoding="", data=b"")
            channels[topic] = writer.register_channel(topic=topic, message_encoding="cdr", schema_id=schema)
        for at_ns, topic, message in stamped(messages):
            raw = bytes(store.serialize_cdr(message, message.__msgtype__))
            writer.add_message(channels[topic], log_time=at_ns, data=raw, publish_time=at_ns)
        if distribution:
            writer.add_metadata("rosbag2", {"ROS_DISTRO": distribution})
        writer.finish()
    return path
