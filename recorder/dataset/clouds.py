"""Point clouds of messages: `sensor_msgs/PointCloud2` with any fields, and Livox's `CustomMsg`."""

import heapq
import itertools
import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection

from carlaloc_env.core.errors import EvaluationError, unknown_name

POINT_CLOUD, LIVOX = "sensor_msgs/msg/PointCloud2", re.compile(r"livox_ros_driver2?/msg/CustomMsg")
"""Types of messages that are read."""
READ = "sensor_msgs/PointCloud2 and livox_ros_driver2/CustomMsg"

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
_AHEAD, _FIRST = 8, 64
"""Number of messages that wait for late ones, and of the first ones, which show whether more must wait."""
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
    return _cloud(_rows(message, np.dtype(layout)), roles, times, stamp_ns, tuple(by_name))


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
        begin += 12 + letters
        if is_cdr:
            begin += -begin % 8
        timebase_ns, count = struct.unpack_from("<Q8xI", body, begin)
        step = 20 if is_cdr else _LIVOX_POINT.itemsize
        points = np.ndarray((count,), _LIVOX_POINT, body, begin + 20, (step,))
    except (struct.error, TypeError, ValueError) as error:
        raise EvaluationError("a Livox cloud is cut off or damaged; give another bag") from error
    names = tuple(_LIVOX_POINT.names or ())
    return _cloud(points, *_roles(names, time_field), sec * 10**9 + nanosec or timebase_ns, names)


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
    rows: NDArray[np.void], roles: dict[str, str], times: list[str], stamp_ns: int, fields: tuple[str, ...]
) -> Cloud:
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
        )


def _tag(label: NDArray[Any]) -> NDArray[np.uint8] | None:
    """Labels as semantic tags; None: they are of another vocabulary, which does not fit into a byte."""
    tag: NDArray[np.uint8] = label.astype(np.uint8)
    return tag if np.array_equal(tag, label) else None


def messages_by_stamp(
    reader: AnyReader, connections: Sequence[Connection]
) -> Iterator[tuple[Connection, int, bytes]]:
    """Messages in the order of their headers' stamps, which need not be that of their recording.

    Args:
        reader: An open reader.
        connections: One or several, whose messages begin with a header.
    """
    waiting: list[tuple[tuple[int, ...], int, int, tuple[Connection, int, bytes]]] = []
    ahead = _ahead(reader, connections)
    for number, message in enumerate(reader.messages(connections)):
        heapq.heappush(waiting, (_stamp(message[2], reader), message[1], number, message))
        if len(waiting) > ahead:
            yield heapq.heappop(waiting)[-1]
    yield from (heapq.heappop(waiting)[-1] for _ in range(len(waiting)))


def _ahead(reader: AnyReader, connections: Sequence[Connection]) -> int:
    """Number of messages that must wait: a few if the first ones are in order, else as many as all need."""
    times = ((_stamp(raw, reader), at_ns) for _, at_ns, raw in reader.messages(connections))
    first = list(itertools.islice(times, _FIRST))
    if first == sorted(first):
        return _AHEAD
    first += times
    return max(number - rank for rank, number in enumerate(sorted(range(len(first)), key=first.__getitem__)))


def _stamp(raw: bytes, reader: AnyReader) -> tuple[int, ...]:
    """Seconds and nanoseconds of a header, which follow ROS 1's counter or CDR's mark of the byte order."""
    order = ">" if reader.is2 and not raw[1] & 1 else "<"
    return struct.unpack_from(f"{order}2I", raw, 4)
