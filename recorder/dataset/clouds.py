"""Point clouds of messages: `sensor_msgs/PointCloud2` with any fields, Livox's `CustomMsg`, and Draco.

Which topic of a bag is a LiDAR's, by its first clouds: maps, boxes, radars and cameras have clouds, too.
"""

import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection

from carlaloc_env.core.errors import EvaluationError, unknown_name
from recorder.bags import refused_in_one_line
from recorder.writers.ros.sensor_messages import columns_of_draco

POINT_CLOUD, LIVOX = "sensor_msgs/msg/PointCloud2", re.compile(r"livox_ros_driver2?/msg/CustomMsg")
CLOUD = re.compile(
    f"{POINT_CLOUD}|{LIVOX.pattern}|foxglove_msgs/msg/CompressedPointCloud|point_cloud_interfaces/msg/.*"
)
"""Types of messages that may be read."""
READ = "sensor_msgs/PointCloud2 and livox_ros_driver2/CustomMsg, foxglove_msgs/CompressedPointCloud by Draco"
DEFAULT_TOPICS = ("/lidar/points", "/lidar/draco")
"""Topics of the clouds of our bags."""

_DATATYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""Numbers of `sensor_msgs/PointField` as NumPy types."""
_NAMES = {
    "x": ("x",),
    "y": ("y",),
    "z": ("z",),
    "ring": ("ring", "line", "channel"),
    "intensity": ("intensity", "intensities", "reflectivity"),
    "label": ("label",),
}
"""Names of fields in lower case by their role, the likeliest first."""
_TIME = re.compile(
    r"(?:(?:point|offset|relative|rel|delta)_?)?(?:time_?stamp|time|stamp|ts|t)(?:_?(?:offset|relative|rel))?"
    r"(?:_(?P<unit>ns|nsec|us|usec|ms|msec|s|sec))?"
)
"""Names of the time of a point, in lower case; some name its unit, too."""
_STEP_MAX = 2**31 - 1
"""Largest point that NumPy can view [bytes]."""
_SINGLE_M = 1000.0
"""Sum of coordinates up to which double ones are rounded to single ones (3e-5 m), as most drivers write them.

Points on the bounds of a system's voxels change sides for less, and poses would hang on the datatype."""
_LIVOX_POINT = np.dtype(
    [
        ("offset_time", "<u4"), ("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("reflectivity", "u1"),
        ("tag", "u1"), ("line", "u1"),
    ]
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Cloud:
    """One message's points that were measured, times as they stand in it."""

    stamp_ns: int
    """Unix time in the header [ns]."""
    points_xyz_m: NDArray[np.float64]
    """Points in the sensor frame [m], shape (N, 3), without rays that have no return (NaN or zero)."""
    times: dict[str, NDArray[Any]]
    """Fields that may be the times of points, the likeliest first, each of shape (N,)."""
    ring: NDArray[np.int64] | None
    intensity: NDArray[np.float64] | None
    tag: NDArray[np.uint8] | None
    fields: tuple[str, ...]
    """Names of all fields."""
    frame_id: str = ""
    """Frame in the header, without a leading ``/``."""


def read_cloud(reader: AnyReader, connection: Connection, raw: bytes, time_field: str | None = None) -> Cloud:
    """Points of a message of any type that is read here.

    Args:
        reader: The open bag.
        connection: The message's.
        raw: The serialized message.
        time_field: The field that holds times; None: those with names of times.

    Raises:
        EvaluationError: it is packed by another program than Draco, lacks a field, or contradicts itself.
        WriterError: it is packed by Draco, whose library is not installed.
    """
    if LIVOX.fullmatch(connection.msgtype):
        point = connection.msgtype.replace("CustomMsg", "CustomPoint")
        if defined := reader.typestore.fielddefs.get(point):
            check_livox([name for name, _ in defined[1]])
        return cloud_of_livox(raw, is_cdr=reader.is2, time_field=time_field)
    message: Any = reader.deserialize(raw, connection.msgtype)
    if connection.msgtype == POINT_CLOUD:
        return cloud_of_fields(message, time_field)
    if message.format == "draco" and hasattr(message, "timestamp"):
        return cloud_of_draco(message, time_field)
    tool = "cloudini_rosbag_converter" if "cloudini" in message.format else "point_cloud_transport"
    raise EvaluationError(f"its clouds are packed by {message.format}; unpack the bag with {tool}")


def cloud_of_fields(message: Any, time_field: str | None = None) -> Cloud:
    """Points of a `sensor_msgs/PointCloud2`, each field by its datatype, offset and byte order.

    Args:
        message: The message, as rosbags reads it.
        time_field: The field that holds times; None: those with names of times.

    Raises:
        EvaluationError: it has no x, y, z, lacks the field of times, or contradicts itself.
    """
    by_name: dict[str, Any] = {}
    for field in message.fields:
        by_name.setdefault(field.name, field)
    roles, times = _roles(tuple(by_name), time_field)
    names = list(dict.fromkeys([*roles.values(), *times]))
    layout: Any = {
        "names": names,
        "formats": [_datatype(by_name[name], message) for name in names],
        "offsets": [by_name[name].offset for name in names],
    }
    stamp = message.header.stamp
    stamp_ns = int(stamp.sec) * 10**9 + int(stamp.nanosec)
    rows = _rows(message, np.dtype(layout))
    return _cloud(rows, roles, times, stamp_ns, tuple(by_name), message.header.frame_id)


def cloud_of_draco(message: Any, time_field: str | None = None) -> Cloud:
    """Points of a `foxglove_msgs/CompressedPointCloud` by Draco; of other programs' clouds positions alone.

    Args:
        message: The message, as rosbags reads it.
        time_field: The field that holds times; None: ``time``, seconds after the stamp.

    Raises:
        WriterError: the library is not installed.
        EvaluationError: it has no such field.
    """
    columns = columns_of_draco(message.data.tobytes())
    if "time_us" in columns:
        columns["time"] = columns.pop("time_us") * 1e-6
    if not columns.get("label", np.ones(1)).any():
        del columns["label"]
    names = tuple(columns)
    kind = np.dtype([(name, values.dtype) for name, values in columns.items()])
    rows = np.rec.fromarrays(list(columns.values()), kind)
    stamp_ns = int(message.timestamp.sec) * 10**9 + int(message.timestamp.nanosec)
    return _cloud(rows, *_roles(names, time_field), stamp_ns, names, message.frame_id)


def check_livox(fields: list[str]) -> None:
    """Refuse a definition of Livox's `CustomPoint` other than the driver's.

    Raises:
        EvaluationError: the names of its fields differ.
    """
    if fields != list(_LIVOX_POINT.names or ()):
        raise EvaluationError(
            f"Livox clouds of this bag have points of {', '.join(fields)}, which are not the driver's; "
            "convert them to sensor_msgs/PointCloud2"
        )


def cloud_of_livox(raw: bytes, *, is_cdr: bool, time_field: str | None = None) -> Cloud:
    """Points of Livox's `CustomMsg`, which are too many to become Python objects.

    Args:
        raw: The serialized message: header, timebase, number of points, id, three reserved bytes, points.
        is_cdr: Whether it is serialized by ROS 2, which aligns every point to four bytes.
        time_field: The field that holds times; None: ``offset_time``.

    Raises:
        EvaluationError: it is cut off, or has no such field.
    """
    body = memoryview(raw)[4 if is_cdr else 0 :]
    try:
        begin = 0 if is_cdr else 4
        sec, nanosec, letters = struct.unpack_from("<iII", body, begin)
        frame_id = bytes(body[begin + 12 : begin + 12 + letters]).decode(errors="replace").rstrip("\0")
        begin += 12 + letters
        if is_cdr:
            begin += -begin % 8
        timebase_ns, count = struct.unpack_from("<Q8xI", body, begin)
        step = 20 if is_cdr else _LIVOX_POINT.itemsize
        points = np.ndarray((count,), _LIVOX_POINT, body, begin + 20, (step,))
    except (struct.error, TypeError, ValueError) as error:
        raise EvaluationError("a Livox cloud is cut off or damaged; give another bag") from error
    names = tuple(_LIVOX_POINT.names or ())
    stamp_ns = sec * 10**9 + nanosec or timebase_ns
    return _cloud(points, *_roles(names, time_field), stamp_ns, names, frame_id)


def unit_in_name(field: str) -> str | None:
    """Unit in the name of a field of times: s, ms, us or ns; None: it has none."""
    found = _TIME.fullmatch(field.lower())
    unit = found["unit"] if found else None
    return unit and unit.removesuffix("ec")


def _roles(fields: tuple[str, ...], time_field: str | None) -> tuple[dict[str, str], list[str]]:
    """Fields by their role, and those that may hold times."""
    lower = {name.lower(): name for name in reversed(fields)}
    roles: dict[str, str] = {}
    for role, known in _NAMES.items():
        if found := [lower[name] for name in known if name in lower]:
            roles[role] = found[0]
    missing = [axis for axis in "xyz" if axis not in roles]
    if missing:
        raise EvaluationError(
            f"a point cloud has no field {', '.join(missing)}; it has {', '.join(fields) or 'none at all'}"
        )
    if time_field is not None and time_field not in fields:
        raise EvaluationError(unknown_name("field of a point cloud", time_field, fields))
    return roles, [time_field] if time_field else [f for f in fields if _TIME.fullmatch(f.lower())]


def _datatype(field: Any, message: Any) -> str:
    kind = _DATATYPES.get(field.datatype)
    if kind is None or field.offset + int(kind[1]) > min(message.point_step, _STEP_MAX):
        raise EvaluationError(
            f"a point cloud's field {field.name} has datatype {field.datatype} at byte {field.offset} of "
            f"{message.point_step}, which cannot be; give clouds as sensor_msgs/PointField describes them"
        )
    return (">" if message.is_bigendian else "<") + kind


def _rows(message: Any, kind: np.dtype[np.void]) -> NDArray[np.void]:
    """A view of all points, row after row; what lies between rows and points is skipped."""
    height, width, step = int(message.height), int(message.width), int(message.point_step)
    data = np.ascontiguousarray(np.asarray(message.data, np.uint8))
    if height * width == 0:
        return np.empty(0, kind)
    # Nodes that crop clouds or join their rows leave row_step as it was, or at zero.
    dense = int(message.row_step) < width * step or len(data) == height * width * step
    row_step = width * step if dense else int(message.row_step)
    if len(data) < (height - 1) * row_step + width * step:
        raise EvaluationError(
            f"a cloud of {height} × {width} points of {step} bytes has {len(data)} bytes; give whole clouds"
        )
    points = np.ndarray((height, width), kind, data, 0, (row_step, step))
    return points[0] if height == 1 else points.reshape(-1)


def _cloud(
    rows: NDArray[np.void], roles: dict[str, str], times: list[str], stamp_ns: int, fields: tuple[str, ...],
    frame_id: str,
) -> Cloud:  # fmt: skip
    axes = [rows[roles[axis]].astype(np.float64) for axis in "xyz"]
    size = np.abs(axes[0]) + np.abs(axes[1]) + np.abs(axes[2])
    # Rays without a return are NaN or zero.
    measured = (size > 0.0) & (size < np.inf)
    if not measured.all():
        rows, axes = rows[measured], [axis[measured] for axis in axes]
    if rows.dtype[roles["x"]].itemsize == 8 and size[measured].max(initial=0.0) < _SINGLE_M:
        axes = [axis.astype(np.float32).astype(np.float64) for axis in axes]
    with np.errstate(invalid="ignore"):  # a ring or label that is NaN
        ring = rows[roles["ring"]].astype(np.int64) if "ring" in roles else None
        return Cloud(
            stamp_ns=stamp_ns,
            points_xyz_m=np.stack(axes, axis=-1),
            times={name: rows[name] for name in times},
            ring=ring,
            intensity=rows[roles["intensity"]].astype(np.float64) if "intensity" in roles else None,
            tag=_tag(rows[roles["label"]]) if "label" in roles else None,
            fields=fields,
            frame_id=frame_id.lstrip("/"),
        )


def _tag(label: NDArray[Any]) -> NDArray[np.uint8] | None:
    """Labels as semantic tags; None: they are of another vocabulary, which does not fit into a byte."""
    tag: NDArray[np.uint8] = label.astype(np.uint8)
    return tag if np.array_equal(tag, label) else None


_SEEN = 12
"""Number of clouds by which a topic is judged."""
_WORLD = re.compile(r"(?:.*[/_])?(?:map|odom|world|camera_init|earth|global|utm|enu)", re.IGNORECASE)
"""Names of frames that do not move with a sensor."""
_OTHERS = {
    "boxes of objects": {"length", "width", "heading", "yaw", "yaw_rate", "size_x"},
    "detections of a radar": {"rcs", "doppler", "range_rate", "dyn_prop", "vx_comp", "v_r"},
    "costs": {"cost", "costs", "path_cost", "occ_cost", "total_cost", "occupancy"},
}
"""Other things than a LiDAR's points, and fields that show them."""
_OF_RADARS = {"velocity", "radial_velocity", "doppler_velocity", "radial_speed", "vx", "snr", "power"}
"""Fields of radars, and of some LiDARs, which have many more points."""
_COLOURS = {"rgb", "rgba"}
_RADAR_POINTS, _FEW_POINTS = 2000, 100
"""Most points of a radar's cloud, and fewest of a LiDAR's."""
_FLAT_M, _SMALL_M, _FAR_M, _CELL_M = 0.05, 1.0, 1000.0, 0.02
"""Least height and extent of a LiDAR's clouds, greatest distance, and least cell of a grid [m]."""
_SLOW_S = 1.5
"""Longest time between sweeps [s]."""


def without_clouds(bag: Path, connections: Sequence[Connection], topic: str | None, known: list[str]) -> str:
    """Why a bag has no clouds to be read on a topic, or (None) none at all."""
    others = {c.topic: c.msgtype for c in connections if topic in (None, c.topic)}
    if topic is not None and not others:
        return f"{bag}: {unknown_name('topic with point clouds', topic, known)}"
    found = ", ".join(f"{name} is {kind}" for name, kind in sorted(others.items(), key=_unlike_a_cloud))
    return f"{bag}: no point clouds that are read here ({READ}); {found or 'it is empty'}"


def _unlike_a_cloud(item: tuple[str, str]) -> tuple[bool, str]:
    return not re.search("scan|packet|cloud|lidar|laser", item[1], re.IGNORECASE), item[0]


def doubt_of(bag: Path, reader: AnyReader, connections: list[Connection], frame: str) -> str:
    """Why a topic is hardly one LiDAR's, by its first clouds; empty: it looks like one's."""
    clouds: list[Cloud] = []
    try:
        with refused_in_one_line(bag):
            for connection, _, raw in islice(reader.messages(connections=connections), _SEEN):
                cloud = read_cloud(reader, connection, raw)
                frame = frame or cloud.frame_id
                if frame == cloud.frame_id and len(cloud.points_xyz_m):
                    clouds.append(cloud)
    except EvaluationError as error:
        return str(error)
    return next(_doubts(clouds), "") if clouds else ""


def of_one_frame(clouds: Iterator[tuple[int, Cloud]], where: str, frame: str) -> Iterator[tuple[int, Cloud]]:
    """Clouds of a frame, each with its time of recording; empty: there must be one alone.

    Raises:
        EvaluationError: there are clouds of two frames, and none is asked for.
    """
    first = frame
    for at_ns, cloud in clouds:
        first = first or cloud.frame_id
        if cloud.frame_id == first:
            yield at_ns, cloud
        elif not frame:
            names = " or ".join(f"{where.rpartition(' ')[2]}:{name}" for name in (first, cloud.frame_id))
            raise EvaluationError(f"{where} has clouds of two sensors; choose by --topic {names}")


def _doubts(clouds: Sequence[Cloud]) -> Iterator[str]:
    """Reasons why clouds of one frame are hardly the sweeps of a LiDAR."""
    fields = {name.lower() for name in clouds[0].fields}
    count = median(len(cloud.points_xyz_m) for cloud in clouds)
    for kind, names in _OTHERS.items():
        if found := ", ".join(sorted(fields & names)):
            yield f"it holds {kind} ({found})"
    if count < _RADAR_POINTS and (found := ", ".join(sorted(fields & _OF_RADARS))):
        yield f"it holds detections of a radar ({found}, {count:.0f} points)"
    if fields & _COLOURS and not (clouds[0].times or clouds[0].ring is not None):
        yield "it holds a camera's coloured points"
    if count < _FEW_POINTS:
        yield f"its clouds have {count:.0f} points"
    yield from _odd_extents(np.concatenate([thinned(cloud.points_xyz_m) for cloud in clouds]))
    if _WORLD.fullmatch(clouds[0].frame_id):
        yield f"its frame '{clouds[0].frame_id}' moves with no sensor: a map, or clouds registered already"
    times_s = np.unique([cloud.stamp_ns for cloud in clouds]) * 1e-9
    if len(times_s) > 1 and (step_s := float(np.median(np.diff(times_s)))) > _SLOW_S:
        yield f"it has a cloud every {step_s:.1f} s"
    if 1 < len(times_s) <= 0.75 * len(clouds) or _take_turns(clouds):
        yield "two sensors of one frame share it: record a topic for each"


def thinned(points_xyz_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """At most 4000 points of a cloud, at steps that no number of rings divides."""
    count = len(points_xyz_m)
    rows = np.linspace(0, count - 1, min(count, 4000)).astype(int)
    return np.asarray(points_xyz_m[rows])


def _odd_extents(points_xyz_m: NDArray[np.float64]) -> Iterator[str]:
    """Ways in which points do not lie around a LiDAR."""
    low, high = np.percentile(points_xyz_m, [5, 95], axis=0)
    if np.ptp(points_xyz_m[:, 2]) < _FLAT_M:
        yield "all of its points lie in one plane"
    if (size_m := (high - low).max()) < _SMALL_M:
        yield f"its points lie within {size_m:.1g} m"
    if (away_m := float(np.median(np.linalg.norm(points_xyz_m, axis=1)))) > _FAR_M:
        yield f"its points lie {away_m / 1000:.0f} km away, in coordinates of a map"
    lines_m = np.unique(points_xyz_m[:, 0])
    if len(lines_m) < 0.05 * len(points_xyz_m) and np.median(np.diff(lines_m)) > _CELL_M:
        yield "its points are cells of a grid"


def _take_turns(clouds: Sequence[Cloud]) -> bool:
    """Whether every second cloud resembles the last but one, and not the last."""
    middles = np.array([cloud.points_xyz_m.mean(axis=0) for cloud in clouds])
    if len(middles) < 6:
        return False
    one, two = (np.median(np.linalg.norm(middles[k:] - middles[:-k], axis=1)) for k in (1, 2))
    return bool(one > 0.5 and two < 0.3 * one)
