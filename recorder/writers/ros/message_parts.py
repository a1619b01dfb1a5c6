"""Parts of ROS messages, for ROS 1 and ROS 2 alike: types, headers, vectors, images, tables."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from carlaloc_env.core import transforms as geometry
from carlaloc_env.core.camera_model import Lens, Pinhole
from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import Sample
from carlaloc_env.sensors.lidar_config import LidarConfig
from recorder.writers.rig_calibration import ImuCalibration
from recorder.writers.text_templates import filled

Message = Any
"""An object of one of the typestore's classes, which exist at run time only."""
MAP_FRAME = "map"
"""Frame of true poses in ROS messages: the world, east, north, up (REP 105)."""
_DATATYPES = {"<f8": 8, "<f4": 7, "<u4": 6, "<i4": 5, "<u2": 4, "|u1": 2}
"""Numbers that `sensor_msgs/PointField` has for datatypes."""
_DEFINED = (
    "tf2_msgs/TFMessage",
    "derived_object_msgs/Object",
    "derived_object_msgs/ObjectArray",
    "radar_msgs/RadarReturn",
    "radar_msgs/RadarScan",
    "foxglove_msgs/CompressedVideo",
    "foxglove_msgs/CompressedPointCloud",
    "dvs_msgs/Event",
    "dvs_msgs/EventArray",
    "livox_ros_driver/CustomPoint",
    "livox_ros_driver/CustomMsg",
    "livox_ros_driver2/CustomPoint",
    "livox_ros_driver2/CustomMsg",
    "gnss_comm/GnssTimeMsg",
    "gnss_comm/GnssObsMsg",
    "gnss_comm/GnssMeasMsg",
    "gnss_comm/GnssEphemMsg",
    "gnss_comm/StampedFloat64Array",
)
"""Message types that rosbags lacks, at least for ROS 1; their definitions lie in ``templates/ros``."""


def make_typestore(
    store: Stores = Stores.ROS1_NOETIC, definitions: Mapping[str, str] | None = None
) -> Typestore:
    """Type store with all message types that the writers use.

    Args:
        store: Version of ROS.
        definitions: Further types, definitions by names such as ``my_msgs/Ranges``.
    """
    typestore = get_typestore(store)
    time = "time" if store == Stores.ROS1_NOETIC else "builtin_interfaces/Time"
    # Livox's two packages have the same messages.
    files = {name: filled(f"ros/{name.replace('driver2', 'driver')}.msg", time=time) for name in _DEFINED}
    for name, text in {**files, **(definitions or {})}.items():
        kind = name.replace("/", "/msg/")
        if kind not in typestore.types:
            typestore.register(get_types_from_msg(text, kind))
    return typestore


class MessageParts:
    """Makes the parts of messages with the types of a type store.

    A header's `seq`, which ROS 1 has and ROS 2 has not, counts per maker and topic; without a topic it is 0.
    """

    def __init__(
        self,
        typestore: Typestore,
        *,
        epoch_ns: int,
        pinholes: Mapping[str, Pinhole],
        lenses: Mapping[str, Lens] | None = None,
        imus: Mapping[str, ImuCalibration] | None = None,
        lidars: Mapping[str, LidarConfig] | None = None,
    ) -> None:
        """Make a maker of parts.

        Args:
            typestore: From `make_typestore`.
            epoch_ns: Added to every stamp [ns].
            pinholes: Intrinsics by name of the colour stream.
            lenses: Distortion by name of the colour stream; none where left out.
            imus: Noise by name of the stream of an IMU; unknown where left out.
            lidars: LiDARs by frame, whose drivers' messages are made.
        """
        self.typestore = typestore
        self.epoch_ns = epoch_ns
        """Added to every stamp [ns]."""
        self._pinholes = pinholes
        self._lenses = lenses or {}
        self._lidars = lidars or {}
        # White noise of density N has the variance N² · rate in each sample.
        self._imu_variances = {
            name: (
                imu.accelerometer_noise_density**2 * imu.rate_hz,
                imu.gyroscope_noise_density**2 * imu.rate_hz,
            )
            for name, imu in (imus or {}).items()
        }
        self._has_seq = "seq" in self.fields_of("std_msgs/Header")
        self._seq: dict[str, int] = {}

    def new(self, type_name: str, **values: Any) -> Message:
        """Message of a type, e.g. ``sensor_msgs/Imu``."""
        return self.typestore.types[type_name.replace("/", "/msg/")](**values)

    def fields_of(self, type_name: str) -> tuple[str, ...]:
        """Names of a message type's fields, which differ between ROS 1 and ROS 2."""
        kind: Any = self.typestore.types[type_name.replace("/", "/msg/")]
        return tuple(field.name for field in dataclasses.fields(kind))

    def time(self, stamp_ns: int) -> Message:
        """Time message of a stamp since the drive began [ns]."""
        total = self.epoch_ns + stamp_ns
        return self.new("builtin_interfaces/Time", sec=total // 10**9, nanosec=total % 10**9)

    def header(self, stamp_ns: int, frame_id: str, topic: str = "") -> Message:
        """Header of a stamp [ns] and frame."""
        values: dict[str, Any] = {"stamp": self.time(stamp_ns), "frame_id": frame_id}
        if self._has_seq:
            values["seq"] = self._seq.get(topic, 0)
            if topic:
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

    def table(self, header: Message, rows: NDArray[np.void], *, is_dense: bool = True) -> Message:
        """PointCloud2 of structured rows (N,) or a grid of them (H, W), one field per column."""
        dtype, (height, width) = rows.dtype, np.atleast_2d(rows).shape
        offsets = {name: entry[1] for name, entry in (dtype.fields or {}).items()}
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
            height=height,
            width=width,
            fields=fields,
            is_bigendian=False,
            point_step=dtype.itemsize,
            row_step=dtype.itemsize * width,
            data=np.ascontiguousarray(rows).reshape(-1).view(np.uint8),
            is_dense=is_dense,
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

    def clock(self, stamp_ns: int) -> Message:
        """Clock at a stamp [ns]."""
        return self.new("rosgraph_msgs/Clock", clock=self.time(stamp_ns))

    def tf_static(self, parent: str, frames: Mapping[str, NDArray[np.float64]], stamp_ns: int) -> Message:
        """Transforms from frames, each by its T_parent_frame (4, 4), to their parent."""
        transforms = [
            self.transform(
                self.header(stamp_ns, parent, "/tf_static"),
                frame,
                T[:3, 3],
                geometry.matrix_to_quat(T[:3, :3]),
            )
            for frame, T in frames.items()
        ]
        return self.new("tf2_msgs/TFMessage", transforms=transforms)

    def transform(
        self, header: Message, child: str, position_m: NDArray[np.float64], quat_xyzw: NDArray[np.float64]
    ) -> Message:
        """Transform from a frame to that of a header, by its pose there."""
        return self.new(
            "geometry_msgs/TransformStamped",
            header=header,
            child_frame_id=child,
            transform=self.new(
                "geometry_msgs/Transform",
                translation=self.vector(position_m),
                rotation=self.quaternion(quat_xyzw),
            ),
        )

    def pinhole(self, stream: str) -> Pinhole:
        """Intrinsics of a colour stream.

        Raises:
            WriterError: the calibration has no such camera.
        """
        if stream not in self._pinholes:
            raise WriterError(f"no calibration of camera stream '{stream}'; give the rig to the writer")
        return self._pinholes[stream]

    def lidar(self, sample: Sample) -> LidarConfig:
        """The LiDAR of a cloud.

        Raises:
            WriterError: the calibration does not know it.
        """
        if sample.frame_id not in self._lidars:
            raise WriterError(f"no LiDAR '{sample.frame_id}' in the calibration; give it the rig's sensors")
        return self._lidars[sample.frame_id]

    def imu_covariances(self, stream: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Covariances of a sample's specific force [m²/s⁴] and body rate [rad²/s²], (9,); 0: unknown."""
        force, rate = self._imu_variances.get(stream, (0.0, 0.0))
        return force * np.eye(3).reshape(-1), rate * np.eye(3).reshape(-1)

    def distortion(self, stream: str) -> tuple[str, NDArray[np.float64]]:
        """Name and coefficients of a colour stream's lens, as sensor_msgs/CameraInfo wants them."""
        lens = self._lenses.get(stream, Lens())
        if lens.model == "equidistant":
            return "equidistant", np.array(lens.coefficients)
        return "plumb_bob", np.array([*lens.coefficients, 0.0])
