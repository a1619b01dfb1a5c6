"""Point clouds of messages: `sensor_msgs/PointCloud2` with any fields, Livox's `CustomMsg`, and Draco."""

import re
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection

from carlaloc_env.core.errors import EvaluationError, unknown_name
from recorder.writers.ros.compact_messages import columns_of_draco

POINT_CLOUD, LIVOX = "sensor_msgs/msg/PointCloud2", re.compile(r"livox_ros_driver2?/msg/CustomMsg")
CLOUD = re.compile(
    f"{POINT_CLOUD}|{LIVOX.pattern}|foxglove_msgs/msg/CompressedPointCloud|point_cloud_interfaces/msg/.*"
)
"""Types of messages that may be read."""
_DATATYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""Numbers of `sensor_msgs/PointField` as NumPy types."""
_NAMES = {
    "x": ("x",),
    "y": ("y",),
    "z": ("z",),
    "ring": ("ring", "line", "channel"),
    "intensity": ("intensity", "intensities", "reflectivity"),
    "label": ("label",),
    "doppler": ("velocity", "doppler", "radial_velocity"),
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
    doppler_mps: NDArray[np.float64] | None = None
    """Rates of the ranges [m/s], receding positive, shape (N,)."""


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
    match = _TIME.fullmatch(field.lower())
    unit = match["unit"] if match else None
    return unit and unit.removesuffix("ec")


def _roles(fields: tuple[str, ...], time_field: str | None) -> tuple[dict[str, str], list[str]]:
    """Fields by their role, and those that may hold times."""
    lower = {name.lower(): name for name in reversed(fields)}
    roles: dict[str, str] = {}
    for role, candidates in _NAMES.items():
        if matches := [lower[name] for name in candidates if name in lower]:
            roles[role] = matches[0]
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
            doppler_mps=rows[roles["doppler"]].astype(np.float64) if "doppler" in roles else None,
            fields=fields,
            frame_id=frame_id.lstrip("/"),
        )


def _tag(label: NDArray[Any]) -> NDArray[np.uint8] | None:
    """Labels as semantic tags; None: they are of another vocabulary, which does not fit into a byte."""
    tag: NDArray[np.uint8] = label.astype(np.uint8)
    return tag if np.array_equal(tag, label) else None
