"""ROS messages of samples: one function per kind, for ROS 1 and ROS 2 alike."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from carlaloc_env import geometry
from carlaloc_env.car_track import WHEELS
from carlaloc_env.errors import WriterError
from carlaloc_env.lens import Lens
from carlaloc_env.pinhole import Pinhole
from carlaloc_env.samples import (
    CanState,
    DepthImage,
    Events,
    FlowImage,
    GnssFix,
    Image,
    Imu,
    NormalImage,
    ObjectList,
    Odometry,
    PointCloud,
    RadarScan,
    Sample,
    SemanticImage,
    Speed,
    WheelTicks,
)
from carlaloc_env.semantics import Tag
from recorder.writers import can_bus, event_messages

Message = Any
"""An object of one of the typestore's classes, which exist at run time only."""
_FLOAT32, _UINT32, _UINT16, _UINT8 = 7, 6, 4, 2
_POINT_DTYPE = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("time", "<f4")]
)
"""velodyne_pointcloud's XYZIRT: offsets 0, 4, 8, 12, 16, 18; time [s] after the header's stamp."""
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
_OBJECT_DTYPE = np.dtype(
    [
        ("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("length", "<f4"), ("width", "<f4"), ("height", "<f4"),
        ("heading", "<f4"), ("pitch", "<f4"), ("vx", "<f4"), ("vy", "<f4"), ("vz", "<f4"),
        ("yaw_rate", "<f4"), ("visible", "<f4"), ("distance", "<f4"), ("label", "u1"), ("id", "<u4"),
    ]
)  # fmt: skip
"""True objects, world frame: metres, radians, m/s, rad/s; visible 0–1 or NaN."""
_CLASSES = {
    Tag.PEDESTRIAN: 4, Tag.RIDER: 5, Tag.BICYCLE: 5, Tag.CAR: 6, Tag.TRUCK: 7, Tag.MOTORCYCLE: 8, Tag.BUS: 9,
    Tag.TRAIN: 9,
}  # fmt: skip
"""derived_object_msgs/Object's classification of semantic tags."""
_DATATYPES = {"<f4": _FLOAT32, "<u4": _UINT32, "<u2": _UINT16, "|u1": _UINT8}


_DEFINITIONS = {
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "derived_object_msgs/msg/Object": "std_msgs/Header header\nuint32 id\nuint8 detection_level\n"
    "uint8 OBJECT_DETECTED=0\nuint8 OBJECT_TRACKED=1\nbool object_classified\ngeometry_msgs/Pose pose\n"
    "geometry_msgs/Twist twist\ngeometry_msgs/Accel accel\ngeometry_msgs/Polygon polygon\n"
    "shape_msgs/SolidPrimitive shape\nuint8 classification\nuint8 CLASSIFICATION_UNKNOWN=0\n"
    "uint8 CLASSIFICATION_UNKNOWN_SMALL=1\nuint8 CLASSIFICATION_UNKNOWN_MEDIUM=2\n"
    "uint8 CLASSIFICATION_UNKNOWN_BIG=3\nuint8 CLASSIFICATION_PEDESTRIAN=4\nuint8 CLASSIFICATION_BIKE=5\n"
    "uint8 CLASSIFICATION_CAR=6\nuint8 CLASSIFICATION_TRUCK=7\nuint8 CLASSIFICATION_MOTORCYCLE=8\n"
    "uint8 CLASSIFICATION_OTHER_VEHICLE=9\nuint8 CLASSIFICATION_BARRIER=10\nuint8 CLASSIFICATION_SIGN=11\n"
    "uint8 classification_certainty\nuint32 classification_age\n",
    "derived_object_msgs/msg/ObjectArray": "std_msgs/Header header\nderived_object_msgs/Object[] objects\n",
    "radar_msgs/msg/RadarReturn": "float32 range\nfloat32 azimuth\nfloat32 elevation\n"
    "float32 doppler_velocity\nfloat32 amplitude\n",
    "can_msgs/msg/Frame": "std_msgs/Header header\nuint32 id\nbool is_rtr\nbool is_extended\n"
    "bool is_error\nuint8 dlc\nuint8[8] data\n",
    "radar_msgs/msg/RadarScan": "std_msgs/Header header\nradar_msgs/RadarReturn[] returns\n",
}
"""Public message types that the type stores of rosbags lack, or that ROS 1's does."""


def make_typestore(store: Stores = Stores.ROS1_NOETIC) -> Typestore:
    """Type store with all message types that the writers use."""
    typestore = get_typestore(store)
    for name, text in {**_DEFINITIONS, **event_messages.definitions(store)}.items():
        if name not in typestore.types:
            typestore.register(get_types_from_msg(text, name))
    return typestore


class MessageMaker:
    """Makes messages of one type store.

    A header's `seq`, which ROS 1 has and ROS 2 has not, counts per maker and topic.
    """

    def __init__(
        self,
        typestore: Typestore,
        *,
        epoch_ns: int,
        pinholes: Mapping[str, Pinhole],
        lenses: Mapping[str, Lens] | None = None,
    ) -> None:
        """Make a maker.

        Args:
            typestore: From `make_typestore`.
            epoch_ns: Added to every stamp [ns].
            pinholes: Intrinsics by name of the colour stream.
            lenses: Distortion by name of the colour stream; none where left out.
        """
        self.typestore = typestore
        self._epoch_ns = epoch_ns
        self._pinholes = pinholes
        self._lenses = lenses or {}
        self._has_seq = "seq" in self.fields_of("std_msgs/Header")
        self._seq: dict[str, int] = {}

    def make(self, encoder: str, sample: Sample, topic: str, frame_id: str | None = None) -> Message:
        """Message of a sample by one of `ENCODERS`."""
        header = self.header(sample.stamp_ns, frame_id or sample.frame_id, topic)
        return ENCODERS[encoder][1](self, header, sample)

    def new(self, type_name: str, **values: Any) -> Message:
        """Message of a type, e.g. ``sensor_msgs/Imu``."""
        return self.typestore.types[type_name.replace("/", "/msg/")](**values)

    def fields_of(self, type_name: str) -> tuple[str, ...]:
        """Names of a message type's fields, which differ between ROS 1 and ROS 2."""
        kind: Any = self.typestore.types[type_name.replace("/", "/msg/")]
        return tuple(field.name for field in dataclasses.fields(kind))

    def time(self, stamp_ns: int) -> Message:
        """Time message of a stamp since the drive began [ns]."""
        total = self._epoch_ns + stamp_ns
        return self.new("builtin_interfaces/Time", sec=total // 10**9, nanosec=total % 10**9)

    def header(self, stamp_ns: int, frame_id: str, topic: str = "") -> Message:
        """Header of a stamp [ns] and frame."""
        values: dict[str, Any] = {"stamp": self.time(stamp_ns), "frame_id": frame_id}
        if self._has_seq:
            values["seq"] = self._seq.get(topic, 0)
            self._seq[topic] = values["seq"] + 1
        return self.new("std_msgs/Header", **values)

    def image(self, header: Message, pixels: NDArray[Any], encoding: str) -> Message:
        """Image of rows of pixels (H, W) or (H, W, C)."""
        data = np.ascontiguousarray(pixels)
        return self.new(
            "sensor_msgs/Image",
            header=header,
            height=data.shape[0],
            width=data.shape[1],
            encoding=encoding,
            is_bigendian=0,
            step=data.strides[0],
            data=data.reshape(-1).view(np.uint8),
        )

    def table(self, header: Message, rows: NDArray[np.void]) -> Message:
        """PointCloud2 of structured rows (N,), one field per column, none of them padded."""
        dtype = rows.dtype
        offsets = {name: place[1] for name, place in (dtype.fields or {}).items()}
        fields = [
            self.new(
                "sensor_msgs/PointField",
                name=name,
                offset=offsets[name],
                datatype=_DATATYPES[dtype[name].str],
                count=1,
            )
            for name in dtype.names or ()
        ]
        return self.new(
            "sensor_msgs/PointCloud2",
            header=header,
            height=1,
            width=len(rows),
            fields=fields,
            is_bigendian=False,
            point_step=dtype.itemsize,
            row_step=dtype.itemsize * len(rows),
            data=rows.view(np.uint8),
            is_dense=True,
        )

    def vector(self, xyz: NDArray[np.float64]) -> Message:
        """Vector3 of three numbers."""
        x, y, z = (float(v) for v in xyz)
        return self.new("geometry_msgs/Vector3", x=x, y=y, z=z)

    def quaternion(self, quat_xyzw: NDArray[np.float64]) -> Message:
        """Quaternion of x, y, z, w."""
        x, y, z, w = (float(v) for v in quat_xyzw)
        return self.new("geometry_msgs/Quaternion", x=x, y=y, z=z, w=w)

    def pose(self, position_m: NDArray[np.float64], quat_xyzw: NDArray[np.float64]) -> Message:
        """Pose of a position [m] and an attitude."""
        x, y, z = (float(v) for v in position_m)
        point = self.new("geometry_msgs/Point", x=x, y=y, z=z)
        return self.new("geometry_msgs/Pose", position=point, orientation=self.quaternion(quat_xyzw))

    def pose_stamped(self, sample: Odometry, topic: str = "") -> Message:
        """Pose of the sample's frame in the world."""
        header = self.header(sample.stamp_ns, "world", topic)
        pose = self.pose(sample.position_m, sample.quat_xyzw)
        return self.new("geometry_msgs/PoseStamped", header=header, pose=pose)

    def clock(self, stamp_ns: int) -> Message:
        """Clock at a stamp [ns]."""
        return self.new("rosgraph_msgs/Clock", clock=self.time(stamp_ns))

    def tf_static(self, parent: str, frames: Mapping[str, NDArray[np.float64]], stamp_ns: int) -> Message:
        """Transforms from frames, each by its T_parent_frame (4, 4), to their parent."""
        transforms = [
            self.new(
                "geometry_msgs/TransformStamped",
                header=self.header(stamp_ns, parent, "/tf_static"),
                child_frame_id=frame,
                transform=self.new(
                    "geometry_msgs/Transform",
                    translation=self.vector(T[:3, 3]),
                    rotation=self.quaternion(geometry.matrix_to_quat(T[:3, :3])),
                ),
            )
            for frame, T in frames.items()
        ]
        return self.new("tf2_msgs/TFMessage", transforms=transforms)

    def pinhole(self, stream: str) -> Pinhole:
        """Intrinsics of a colour stream.

        Raises:
            WriterError: the calibration has no such camera.
        """
        if stream not in self._pinholes:
            raise WriterError(f"no calibration of camera stream '{stream}'; give the rig to the writer")
        return self._pinholes[stream]

    def distortion(self, stream: str) -> tuple[str, NDArray[np.float64]]:
        """Name and coefficients of a colour stream's lens, as sensor_msgs/CameraInfo wants them."""
        lens = self._lenses.get(stream, Lens())
        if lens.model == "equidistant":
            return "equidistant", np.array(lens.coefficients)
        return "plumb_bob", np.array([*lens.coefficients, 0.0])


def _image_rgb8(maker: MessageMaker, header: Message, sample: Image) -> Message:
    return maker.image(header, sample.rgb, "rgb8")


def _image_mono8(maker: MessageMaker, header: Message, sample: Image) -> Message:
    return maker.image(header, grey(sample), "mono8")


def grey(sample: Image) -> NDArray[np.uint8]:
    """Brightness 0–255 of a picture (ITU-R BT.601), shape (H, W)."""
    return cast(NDArray[np.uint8], cv2.cvtColor(sample.rgb, cv2.COLOR_RGB2GRAY))


def _image_32fc1(maker: MessageMaker, header: Message, sample: DepthImage) -> Message:
    return maker.image(header, sample.depth_m, "32FC1")


def _image_tags(maker: MessageMaker, header: Message, sample: SemanticImage) -> Message:
    return maker.image(header, sample.tag, "mono8")


def _image_32fc2(maker: MessageMaker, header: Message, sample: FlowImage) -> Message:
    return maker.image(header, sample.flow_px, "32FC2")


def _image_32fc3(maker: MessageMaker, header: Message, sample: NormalImage) -> Message:
    return maker.image(header, sample.normal, "32FC3")


def _event_array(maker: MessageMaker, header: Message, sample: Events) -> Message:
    """Without the events themselves, which bags append in one piece."""
    return maker.new(
        "dvs_msgs/EventArray", header=header, height=sample.height_px, width=sample.width_px, events=[]
    )


def _camera_info(maker: MessageMaker, header: Message, sample: Image) -> Message:
    pinhole = maker.pinhole(sample.sensor)
    K = pinhole.K
    roi = maker.new(
        "sensor_msgs/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
    )
    upper = "D" in maker.fields_of("sensor_msgs/CameraInfo")
    model, coefficients = maker.distortion(sample.sensor)
    matrices = {
        "d": coefficients,
        "k": K.reshape(-1),
        "r": np.eye(3).reshape(-1),
        "p": np.hstack([K, np.zeros((3, 1))]).reshape(-1),
    }
    return maker.new(
        "sensor_msgs/CameraInfo",
        header=header,
        height=pinhole.height_px,
        width=pinhole.width_px,
        distortion_model=model,
        binning_x=0,
        binning_y=0,
        roi=roi,
        **{name.upper() if upper else name: value for name, value in matrices.items()},
    )


def _points(maker: MessageMaker, header: Message, sample: PointCloud) -> Message:
    return _cloud(maker, header, sample, _POINT_DTYPE)


def _points_labelled(maker: MessageMaker, header: Message, sample: PointCloud) -> Message:
    return _cloud(maker, header, sample, _LABELLED_DTYPE)


def _cloud(maker: MessageMaker, header: Message, sample: PointCloud, dtype: np.dtype[np.void]) -> Message:
    rows = np.zeros(len(sample.points_xyz_m), dtype=dtype)
    for axis, name in enumerate("xyz"):
        rows[name] = sample.points_xyz_m[:, axis]
    rows["intensity"] = sample.intensity
    rows["ring"] = sample.ring
    rows["time"] = sample.offset_ns * 1e-9
    if "label" in (dtype.names or ()):
        rows["label"] = sample.tag if sample.tag is not None else 0
        rows["id"] = sample.instance if sample.instance is not None else 0
    return maker.table(header, rows)


def _radar_points(maker: MessageMaker, header: Message, sample: RadarScan) -> Message:
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


def _radar_scan(maker: MessageMaker, header: Message, sample: RadarScan) -> Message:
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


def _imu(maker: MessageMaker, header: Message, sample: Imu) -> Message:
    covariance = np.eye(3).reshape(-1) * sample.orientation_noise_rad**2
    if sample.quat_xyzw is None:
        covariance = np.zeros(9)
        covariance[0] = -1.0  # sensor_msgs/Imu: "no orientation estimate"
    quat = sample.quat_xyzw if sample.quat_xyzw is not None else np.array([0.0, 0.0, 0.0, 1.0])
    return maker.new(
        "sensor_msgs/Imu",
        header=header,
        orientation=maker.quaternion(quat),
        orientation_covariance=covariance,
        angular_velocity=maker.vector(sample.angular_rate_radps),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=maker.vector(sample.specific_force_mps2),
        linear_acceleration_covariance=np.zeros(9),
    )


def _nav_sat_fix(maker: MessageMaker, header: Message, sample: GnssFix) -> Message:
    # A base station's corrections are an augmentation from the ground (STATUS_GBAS_FIX).
    level = {"none": -1, "single": 0, "float": 2, "fixed": 2}[sample.solution if sample.has_fix else "none"]
    status = maker.new("sensor_msgs/NavSatStatus", status=level, service=1)
    covariance = sample.covariance_enu_m2
    diagonal = not np.any(covariance - np.diag(np.diag(covariance)))
    return maker.new(
        "sensor_msgs/NavSatFix",
        header=header,
        status=status,
        latitude=sample.latitude_deg,
        longitude=sample.longitude_deg,
        altitude=sample.altitude_m,
        position_covariance=np.ascontiguousarray(covariance).reshape(-1),
        position_covariance_type=(2 if diagonal else 3) if sample.has_fix else 0,
    )


def _twist(maker: MessageMaker, header: Message, sample: Speed) -> Message:
    linear = maker.vector(np.array([sample.speed_mps, 0.0, 0.0]))
    twist = maker.new("geometry_msgs/Twist", linear=linear, angular=maker.vector(np.zeros(3)))
    return maker.new("geometry_msgs/TwistStamped", header=header, twist=twist)


def _wheel_joints(maker: MessageMaker, header: Message, sample: WheelTicks) -> Message:
    """Angles are whole ticks."""
    return maker.new(
        "sensor_msgs/JointState",
        header=header,
        name=[f"wheel_{name}" for name in WHEELS],
        position=sample.ticks * (2.0 * np.pi / sample.ticks_per_turn),
        velocity=sample.rate_radps,
        effort=np.zeros(0),
    )


def _can_frame(frame: str) -> Callable[[MessageMaker, Message, Any], Message]:
    def make(maker: MessageMaker, header: Message, sample: CanState) -> Message:
        identifier, data = can_bus.encode(frame, sample)
        return maker.new(
            "can_msgs/Frame",
            header=header,
            id=identifier,
            is_rtr=False,
            is_extended=False,
            is_error=False,
            dlc=len(data),
            data=np.frombuffer(data.ljust(8, b"\0"), dtype=np.uint8),
        )

    return make


def _objects(maker: MessageMaker, header: Message, sample: ObjectList) -> Message:
    """Boxes in the world; the twist is in world axes, as CARLA's ROS bridge has it."""
    nothing = maker.vector(np.zeros(3))
    still = maker.new("geometry_msgs/Accel", linear=nothing, angular=nothing)
    no_polygon = maker.new("geometry_msgs/Polygon", points=[])
    # ROS 2's primitive has a polygon of its own for prisms.
    extra = {"polygon": no_polygon} if "polygon" in maker.fields_of("shape_msgs/SolidPrimitive") else {}
    objects = [
        maker.new(
            "derived_object_msgs/Object",
            header=header,
            id=int(sample.id[k]),
            detection_level=1,
            object_classified=True,
            pose=maker.pose(sample.position_m[k], quat),
            twist=maker.new(
                "geometry_msgs/Twist",
                linear=maker.vector(sample.velocity_mps[k]),
                angular=maker.vector(np.array([0.0, 0.0, sample.yaw_rate_radps[k]])),
            ),
            accel=still,
            polygon=no_polygon,
            shape=maker.new("shape_msgs/SolidPrimitive", type=1, dimensions=sample.size_m[k].copy(), **extra),
            classification=_CLASSES.get(Tag(int(sample.tag[k])), 0),
            classification_certainty=255,
            classification_age=0,
        )
        for k, quat in enumerate(sample.quat_xyzw)
    ]
    return maker.new("derived_object_msgs/ObjectArray", header=header, objects=objects)


def _object_table(maker: MessageMaker, header: Message, sample: ObjectList) -> Message:
    rows = np.zeros(len(sample.id), dtype=_OBJECT_DTYPE)
    for names, values in (
        (("x", "y", "z"), sample.position_m),
        (("length", "width", "height"), sample.size_m),
        (("vx", "vy", "vz"), sample.velocity_mps),
    ):
        for axis, name in enumerate(names):
            rows[name] = values[:, axis]
    rows["heading"], rows["pitch"], rows["yaw_rate"] = (
        sample.heading_rad,
        sample.pitch_rad,
        sample.yaw_rate_radps,
    )
    rows["visible"], rows["distance"] = sample.visible, sample.distance_m
    rows["label"], rows["id"] = sample.tag, sample.id
    return maker.table(header, rows)


def _image_instances(maker: MessageMaker, header: Message, sample: SemanticImage) -> Message:
    return maker.image(header, sample.instance.astype(np.int32), "32SC1")


def _acceleration(maker: MessageMaker, header: Message, sample: Odometry) -> Message:
    """In the axes of the frame itself, gravity not included."""
    turn = geometry.quat_conjugate(sample.quat_xyzw)
    linear = maker.vector(geometry.quat_rotate(turn, sample.acceleration_world_mps2))
    accel = maker.new("geometry_msgs/Accel", linear=linear, angular=maker.vector(np.zeros(3)))
    return maker.new("geometry_msgs/AccelStamped", header=header, accel=accel)


def _odometry(maker: MessageMaker, header: Message, sample: Odometry) -> Message:
    """The pose is in the header's frame, the twist in the child's (nav_msgs/Odometry)."""
    velocity = geometry.quat_rotate(geometry.quat_conjugate(sample.quat_xyzw), sample.velocity_world_mps)
    twist = maker.new(
        "geometry_msgs/Twist",
        linear=maker.vector(velocity),
        angular=maker.vector(sample.angular_rate_radps),
    )
    header.frame_id = "world"
    return maker.new(
        "nav_msgs/Odometry",
        header=header,
        child_frame_id=sample.frame_id,
        pose=maker.new(
            "geometry_msgs/PoseWithCovariance",
            pose=maker.pose(sample.position_m, sample.quat_xyzw),
            covariance=np.zeros(36),
        ),
        twist=maker.new("geometry_msgs/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
    )


ENCODERS: dict[str, tuple[str, Callable[[MessageMaker, Message, Any], Message]]] = {
    "image_rgb8": ("sensor_msgs/msg/Image", _image_rgb8),
    "image_mono8": ("sensor_msgs/msg/Image", _image_mono8),
    "image_32fc1": ("sensor_msgs/msg/Image", _image_32fc1),
    "image_tags": ("sensor_msgs/msg/Image", _image_tags),
    "image_32fc2": ("sensor_msgs/msg/Image", _image_32fc2),
    "image_32fc3": ("sensor_msgs/msg/Image", _image_32fc3),
    "event_array": ("dvs_msgs/msg/EventArray", _event_array),
    "camera_info": ("sensor_msgs/msg/CameraInfo", _camera_info),
    "points": ("sensor_msgs/msg/PointCloud2", _points),
    "points_labelled": ("sensor_msgs/msg/PointCloud2", _points_labelled),
    "radar_points": ("sensor_msgs/msg/PointCloud2", _radar_points),
    "radar_scan": ("radar_msgs/msg/RadarScan", _radar_scan),
    "imu": ("sensor_msgs/msg/Imu", _imu),
    "nav_sat_fix": ("sensor_msgs/msg/NavSatFix", _nav_sat_fix),
    "twist": ("geometry_msgs/msg/TwistStamped", _twist),
    "wheel_joints": ("sensor_msgs/msg/JointState", _wheel_joints),
    "can_steering": ("can_msgs/msg/Frame", _can_frame("STEERING_AND_SPEED")),
    "can_wheels": ("can_msgs/msg/Frame", _can_frame("WHEEL_SPEEDS")),
    "can_pedals": ("can_msgs/msg/Frame", _can_frame("PEDALS")),
    "objects": ("derived_object_msgs/msg/ObjectArray", _objects),
    "object_table": ("sensor_msgs/msg/PointCloud2", _object_table),
    "image_instances": ("sensor_msgs/msg/Image", _image_instances),
    "acceleration": ("geometry_msgs/msg/AccelStamped", _acceleration),
    "odometry": ("nav_msgs/msg/Odometry", _odometry),
}
"""Message type and function of every way to write a sample."""
