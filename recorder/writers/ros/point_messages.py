"""ROS messages of points and detections: tables with a field per column."""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.samples import ObjectList, PointCloud, RadarScan
from carlaloc_env.scene.semantic_tags import Tag
from recorder.writers.ros.message_parts import Message, MessageParts

_POINT_DTYPE = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("time", "<f4")]
)
"""velodyne_pointcloud's XYZIRT: offsets 0, 4, 8, 12, 16, 18; time [s] after the header's stamp."""
_ROAD_USERS = np.array(
    [Tag.PEDESTRIAN, Tag.RIDER, Tag.CAR, Tag.TRUCK, Tag.BUS, Tag.TRAIN, Tag.MOTORCYCLE, Tag.BICYCLE]
)
"""CARLA's tags 4 and 10 at the time of the paper: pedestrians and vehicles."""
_LABELLED_DTYPE = np.dtype([*_POINT_DTYPE.descr, ("label", "u1"), ("id", "<u4")])
_RADAR_DTYPE = np.dtype(
    [
        *(
            (name, "<f4")
            for name in ("x", "y", "z", "doppler", "snr", "rcs", "range", "azimuth", "elevation")
        ),
        ("label", "u1"),
        ("id", "<u4"),
        ("origin", "u1"),
    ]
)
"""Detections: metres, m/s (positive = moving away), dB, dBsm, radians; label, id and origin are truth."""
_OBJECT_COLUMNS = (
    "length", "width", "height", "heading", "pitch", "roll", "vx", "vy", "vz", "yaw_rate", "visible",
    "distance", "label", "id",
)  # fmt: skip
"""Of true objects, world frame: metres, radians, m/s, rad/s; visible 0–1 or NaN."""


def points(maker: MessageParts, header: Message, sample: PointCloud) -> Message:
    """Points as velodyne_pointcloud's XYZIRT."""
    return maker.table(header, _rows(sample, _POINT_DTYPE))


def points_us(maker: MessageParts, header: Message, sample: PointCloud) -> Message:
    """The same with times in microseconds."""
    rows = _rows(sample, _POINT_DTYPE)
    rows["time"] = sample.offset_ns * 1e-3
    return maker.table(header, rows)


def points_labelled(maker: MessageParts, header: Message, sample: PointCloud) -> Message:
    """Points as XYZIRT with tag and instance id."""
    return maker.table(header, _rows(sample, _LABELLED_DTYPE))


def points_of_the_town(maker: MessageParts, header: Message, sample: PointCloud) -> Message:
    """The plain cloud without points on walkers and vehicles, parked ones included: the paper's `seg`."""
    rows = _rows(sample, _POINT_DTYPE)
    if sample.tag is not None:
        rows = rows[~np.isin(sample.tag, _ROAD_USERS)]
    return maker.table(header, rows)


def _rows(sample: PointCloud, dtype: np.dtype[np.void]) -> NDArray[np.void]:
    rows = np.zeros(len(sample.points_xyz_m), dtype=dtype)
    for axis, name in enumerate("xyz"):
        rows[name] = sample.points_xyz_m[:, axis]
    rows["intensity"] = sample.intensity
    rows["ring"] = sample.ring
    rows["time"] = sample.offset_ns * 1e-9
    if "label" in (dtype.names or ()):
        rows["label"] = sample.tag if sample.tag is not None else 0
        rows["id"] = sample.instance if sample.instance is not None else 0
    return rows


def radar_points(maker: MessageParts, header: Message, sample: RadarScan) -> Message:
    """Detections with the truth behind each."""
    rows = np.zeros(len(sample.range_m), dtype=_RADAR_DTYPE)
    for axis, name in enumerate("xyz"):
        rows[name] = sample.points_xyz_m[:, axis]
    rows["doppler"], rows["snr"], rows["rcs"] = sample.doppler_mps, sample.snr_db, sample.rcs_dbsm
    rows["range"], rows["azimuth"], rows["elevation"] = (
        sample.range_m,
        sample.azimuth_rad,
        sample.elevation_rad,
    )
    rows["label"], rows["id"], rows["origin"] = sample.tag, sample.instance, sample.origin
    return maker.table(header, rows)


def radar_scan(maker: MessageParts, header: Message, sample: RadarScan) -> Message:
    """The amplitude is the signal-to-noise ratio [dB]; the Doppler is positive when moving away."""
    columns = (
        sample.range_m,
        sample.azimuth_rad,
        sample.elevation_rad,
        sample.doppler_mps,
        sample.snr_db,
    )
    names = ("range", "azimuth", "elevation", "doppler_velocity", "amplitude")
    returns = [
        maker.new("radar_msgs/RadarReturn", **dict(zip(names, row, strict=True)))
        for row in zip(*(column.tolist() for column in columns), strict=True)
    ]
    return maker.new("radar_msgs/RadarScan", header=header, returns=returns)


def object_table(maker: MessageParts, header: Message, sample: ObjectList) -> Message:
    """Boxes, velocities and visibility of true objects; no reader takes this type for a LiDAR's clouds.

    Ids are below 2^24, so that single precision holds them.
    """
    angles = np.stack([sample.heading_rad, sample.pitch_rad, sample.roll_rad], axis=1)
    others = (sample.yaw_rate_radps, sample.visible, sample.distance_m, sample.tag, sample.id)
    columns = np.column_stack([sample.size_m, angles, sample.velocity_mps, *others]).T.astype(np.float32)
    return maker.new(
        "sensor_msgs/PointCloud",
        header=header,
        points=[maker.new("geometry_msgs/Point32", x=x, y=y, z=z) for x, y, z in sample.position_m.tolist()],
        channels=[
            maker.new("sensor_msgs/ChannelFloat32", name=name, values=values.copy())
            for name, values in zip(_OBJECT_COLUMNS, columns, strict=True)
        ],
    )
