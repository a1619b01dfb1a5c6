"""ROS messages of clouds as LiDARs' drivers publish them: fields, datatypes, offsets, order, times.

Drivers that report rays without a return have them here, too: Ouster's and RoboSense's as NaN, Livox's and
those of Ouster's first driver at 0.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.samples import PointCloud
from carlaloc_env.sensors.lidar_config import LidarConfig
from recorder.writers.ros.message_parts import Message, MessageParts

LIVOX_TYPE = "livox_ros_driver2/msg/CustomMsg"
"""Type of Livox's messages; the older package has the same under its name."""
_XYZI = [(name, "<f4") for name in ("x", "y", "z", "intensity")]
_STAMPED = np.dtype([*_XYZI, ("ring", "<u2"), ("timestamp", "<f8")])
"""hesai_ros_driver and rslidar_sdk: 26 bytes, times in seconds since 1970."""
_LIVOX_FIELDS = np.dtype([*_XYZI, ("tag", "u1"), ("line", "u1"), ("timestamp", "<f8")])
"""livox_ros_driver2's PointCloud2: 26 bytes, times in nanoseconds since 1970."""
_LIVOX_POINT = [
    *(("offset_time", "<u4"), ("x", "<f4"), ("y", "<f4"), ("z", "<f4")),
    *(("reflectivity", "u1"), ("tag", "u1"), ("line", "u1")),
]


def _of_pcl(*fields: tuple[str, str, int]) -> np.dtype[np.void]:
    """48 bytes of x, y, z and some fields with their offsets, as PCL's structures lie in memory."""
    named = [("x", "<f4", 0), ("y", "<f4", 4), ("z", "<f4", 8), *fields]
    names, formats, offsets = (list(column) for column in zip(*named, strict=True))
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": 48})


def _of_ouster(ring: str) -> np.dtype[np.void]:
    return _of_pcl(
        ("intensity", "<f4", 16), ("t", "<u4", 20), ("reflectivity", "<u2", 24), ("ring", ring, 26),
        ("ambient", "<u2", 28), ("range", "<u4", 32),
    )  # fmt: skip


_OUSTER, _OUSTER_2021 = _of_ouster("<u2"), _of_ouster("u1")
"""ouster-ros' point type `original`, and its forerunner's: times in nanoseconds, ranges in millimetres."""
_AEVA = _of_pcl(
    ("intensity", "<f4", 16), ("reflectivity", "<f4", 20), ("velocity", "<f4", 24),
    ("time_offset_ns", "<i4", 28), ("line_index", "u1", 32),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Firings:
    """All firings of a sweep, those without a return included: columns, and beams in the order of firing."""

    column: NDArray[np.int64]
    """Column of each point, shape (N,)."""
    place: NDArray[np.int64]
    """Place of its beam within the column, shape (N,)."""
    offset_ns: NDArray[np.int64]
    """Times after the sweep began [ns], shape (columns, beams)."""
    ring: NDArray[np.int64]
    """Ring of each place, shape (beams,)."""

    def rows(self, dtype: np.dtype[np.void], points: dict[str, Any], empty: float) -> NDArray[np.void]:
        """A row for each firing (columns, beams): fields of points, else `empty` in x, y, z and zeros."""
        rows = np.zeros(self.offset_ns.shape, dtype)
        for axis in "xyz":
            rows[axis] = empty
        for name, values in points.items():
            rows[name][self.column, self.place] = values
        return rows


def _firings(lidar: LidarConfig, sample: PointCloud) -> _Firings:
    firing_ns = np.array(lidar.firing_ns or [0] * lidar.rings)
    order = np.argsort(firing_ns, kind="stable")
    firing_ns = firing_ns[order]
    ring = lidar.rings - 1 - order if lidar.rings_from_top else order
    place = np.argsort(ring)[sample.ring]
    # Where columns are no whole number, a sweep's first one begins a little after the sweep.
    begin_ns = sample.offset_ns.astype(np.int64) - firing_ns[place]
    column_ns = lidar.sweep_ns / float(lidar.columns_per_sweep)
    first_ns = int(begin_ns[0]) if len(begin_ns) else 0
    column = np.rint((begin_ns - first_ns) / column_ns).astype(np.int64) + int(first_ns / column_ns + 1e-3)
    late_ns = first_ns - (int(column[0]) if len(column) else 0) * column_ns
    count = max(round((lidar.sweep_ns - late_ns) / column_ns + 0.499), int(column.max(initial=0)) + 1)
    columns_ns = late_ns + np.arange(count)[:, None] * column_ns
    return _Firings(column, place, np.rint(columns_ns + firing_ns).astype(np.int64).clip(0), ring)


def _fields(sample: PointCloud, **others: Any) -> dict[str, Any]:
    """Values of x, y, z, intensity and other fields."""
    values = dict(zip("xyz", sample.points_xyz_m.T, strict=True))
    return {**values, "intensity": sample.intensity, **others}


def _unix_s(unix_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Times [s since 1970] of whole nanoseconds, rounded once."""
    whole_s, rest_ns = np.divmod(unix_ns, 10**9)
    return whole_s + 1e-9 * rest_ns


def _packed(dtype: np.dtype[np.void], values: dict[str, Any]) -> NDArray[np.void]:
    rows = np.zeros(len(values["x"]), dtype)
    for name, column in values.items():
        rows[name] = column
    return rows


def _of_ouster_points(sample: PointCloud) -> dict[str, Any]:
    range_mm = np.rint(1e3 * np.linalg.norm(sample.points_xyz_m, axis=1))
    return _fields(sample, reflectivity=np.rint(sample.intensity), range=range_mm)


def points_ouster_2021(maker: MessageParts, header: Message, sample: PointCloud) -> Message:
    """The same as `points_ouster`, with 8 bits for the ring, and zeros without a return."""
    return maker.table(header, _turns_of_ouster(maker.lidar(sample), sample, _OUSTER_2021, 0.0))


def points_ouster(maker: MessageParts, header: Message, sample: PointCloud) -> Message:
    """Rows of an Ouster from the top, each a turn, shifted so that equal azimuths are one column."""
    rows = _turns_of_ouster(maker.lidar(sample), sample, _OUSTER, np.nan)
    return maker.table(header, rows, is_dense=False)


def _turns_of_ouster(
    lidar: LidarConfig, sample: PointCloud, dtype: np.dtype[np.void], empty: float
) -> NDArray[np.void]:
    firings = _firings(lidar, sample)
    rows = firings.rows(dtype, _of_ouster_points(sample), empty)
    rows["t"], rows["ring"] = firings.offset_ns, firings.ring
    by_row = np.argsort(firings.ring)
    # Beams to the left see an azimuth later: the metadata's pixel_shift_by_row, with the other sign.
    left_deg = np.array(lidar.azimuth_offsets_deg or [0.0] * lidar.rings)
    left = np.rint(left_deg / 360.0 * len(rows)).astype(int)[:: -1 if lidar.rings_from_top else 1]
    source = (np.arange(len(rows)) + left[:, None]) % len(rows)
    turned: NDArray[np.void] = rows[source, by_row[:, None]]
    return turned


def points_hesai(maker: MessageParts, header: Message, sample: PointCloud) -> Message:
    """Points of a Hesai, which are not said to be dense."""
    time_s = _unix_s(maker.epoch_ns + sample.stamp_ns + sample.offset_ns.astype(np.int64))
    values = _fields(sample, ring=sample.ring, timestamp=time_s)
    return maker.table(header, _packed(_STAMPED, values), is_dense=False)


def points_robosense(maker: MessageParts, header: Message, sample: PointCloud) -> Message:
    """A row for each column of a RoboSense, its channels in the order of firing."""
    firings = _firings(maker.lidar(sample), sample)
    rows = firings.rows(_STAMPED, _fields(sample), np.nan)
    rows["ring"] = firings.ring
    rows["timestamp"] = _unix_s(maker.epoch_ns + sample.stamp_ns + firings.offset_ns)
    return maker.table(header, rows, is_dense=False)


def points_livox(maker: MessageParts, header: Message, sample: PointCloud) -> Message:
    """All points of a Livox as a PointCloud2."""
    firings = _firings(maker.lidar(sample), sample)
    rows = firings.rows(_LIVOX_FIELDS, _fields(sample, intensity=np.rint(sample.intensity)), 0.0)
    rows["line"] = firings.ring
    rows["timestamp"] = maker.epoch_ns + sample.stamp_ns + firings.offset_ns
    return maker.table(header, rows.reshape(-1))


def points_aeva(maker: MessageParts, header: Message, sample: PointCloud) -> Message:
    """Points of an Aeva with their velocities [m/s], receding positive."""
    velocity = {} if sample.doppler_mps is None else {"velocity": sample.doppler_mps}
    values = _fields(
        sample, reflectivity=sample.intensity, time_offset_ns=sample.offset_ns, line_index=sample.ring
    )
    return maker.table(header, _packed(_AEVA, values | velocity))


def livox(maker: MessageParts, header: Message, sample: PointCloud) -> Message:
    """Livox's message without points, which `with_livox_points` appends: they are too many for objects."""
    lidar = maker.lidar(sample)
    return maker.new(
        LIVOX_TYPE.replace("/msg", ""),
        header=header,
        timebase=maker.epoch_ns + sample.stamp_ns,
        point_num=_firings(lidar, sample).offset_ns.size,
        lidar_id=0,
        rsvd=np.zeros(3, np.uint8),
        points=[],
    )


def with_livox_points(empty: bytes, lidar: LidarConfig, sample: PointCloud, *, is_cdr: bool) -> bytes:
    """A serialised Livox message without points, and with all points of a sweep.

    Args:
        empty: The message; it ends with a count of 0.
        lidar: The sensor.
        sample: Its points.
        is_cdr: Whether ROS 2 reads it, where every point but the last takes 20 bytes in place of 19.
    """
    firings = _firings(lidar, sample)
    values = _fields(sample, reflectivity=np.rint(sample.intensity))
    del values["intensity"]
    dtype = np.dtype([*_LIVOX_POINT, ("", "u1")] if is_cdr else _LIVOX_POINT)
    rows = firings.rows(dtype, values, 0.0)
    rows["line"], rows["offset_time"] = firings.ring, firings.offset_ns
    return empty[:-4] + np.uint32(rows.size).tobytes() + rows.tobytes()[: -1 if is_cdr else None]
