"""ROS messages of sensors: images, clouds, detections, and their compact forms.

ROS messages of cameras: images, their calibration, events.

ROS messages of points and detections: tables with a field per column.

ROS messages of the profiles `compact`: video, depth and labels as PNG, clouds by Draco.

docs/formats.md gives the losses of each, and tests hold them.

H.264 for `foxglove_msgs/CompressedVideo`: each message holds a picture that can be shown at once.
"""

import struct
from collections.abc import Callable
from fractions import Fraction
from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import DepthImage, Events, Image, ObjectList, PointCloud, RadarScan, SemanticImage
from carlaloc_env.scene.semantic_tags import Tag
from recorder.writers.base import png_of
from recorder.writers.ros.message_parts import Message, MessageParts


def image_encoder(
    encoding: str, pixels_of: Callable[[Any], NDArray[Any]]
) -> Callable[[MessageParts, Message, Any], Message]:
    """Function that makes images of an encoding from an array of a sample."""
    return lambda maker, header, sample: maker.image(header, pixels_of(sample), encoding)


def event_array(maker: MessageParts, header: Message, sample: Events) -> Message:
    """Header and size; bags append all events as a block."""
    return maker.new(
        "dvs_msgs/EventArray", header=header, height=sample.height_px, width=sample.width_px, events=[]
    )


def camera_info(maker: MessageParts, header: Message, sample: Image) -> Message:
    """Intrinsics and distortion of a colour stream, whose lens is not undone."""
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


def points_labelled(maker: MessageParts, header: Message, sample: PointCloud) -> Message:
    """The same with tag and instance id."""
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


I420 = "i420"
"""Format of a picture that is yet to be encoded, followed by width and height [px]."""
DEPTH_A_M, DEPTH_MAX_M = 180.0 * 181.0, 1000.0
"""compressedDepth's depthParam[0] [m], of ROS's `depth_quantization` 180, and farthest depth [m]."""
_INVERSE_DEPTH = 1
_PNG = (cv2.IMWRITE_PNG_COMPRESSION, 3)
_DRACO_BITS = 14
DRACO_FIELDS = ("intensity", "ring", "time_us", "label", "id")
"""Generic attributes of a Draco cloud, in their order."""
_GENERIC = 4
"""Draco's type of attributes without a standard meaning."""


def video(maker: MessageParts, header: Message, sample: Image) -> Message:
    """A picture in 4:2:0 of BT.709; bags encode it in the order of time, see `VideoEncoder`."""
    # Imported here: other profiles do without FFmpeg's libraries.
    import av

    height, width = sample.rgb.shape[:2]
    frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(sample.rgb), format="rgb24")
    planes = frame.reformat(format="yuv420p", dst_colorspace="ITU709").to_ndarray()
    return maker.new(
        "foxglove_msgs/CompressedVideo",
        timestamp=header.stamp,
        frame_id=header.frame_id,
        data=planes.reshape(-1),
        format=f"{I420} {width} {height}",
    )


def depth_png(maker: MessageParts, header: Message, sample: DepthImage) -> Message:
    """Inverse depth in 16 bits, as ROS's compressed_depth_image_transport has it for 32FC1."""
    B = 1.0 - DEPTH_A_M / DEPTH_MAX_M
    depth = sample.depth_m
    with np.errstate(divide="ignore"):
        code = np.rint(DEPTH_A_M / depth + B)
    code = np.where((depth > 0) & (depth < DEPTH_MAX_M), np.clip(code, 1, 65535), 0).astype(np.uint16)
    config = struct.pack("<iff", _INVERSE_DEPTH, DEPTH_A_M, B)
    data = config + png_of(code, sample.sensor, _PNG)
    return _compressed(maker, header, "32FC1; compressedDepth png", data)


def depth_of_png(data: bytes) -> NDArray[np.float32]:
    """Planar depth [m] of a compressedDepth message's data, 0 where there is none, shape (H, W)."""
    _, A, B = struct.unpack_from("<iff", data)
    code = cv2.imdecode(np.frombuffer(data, np.uint8, offset=12), cv2.IMREAD_UNCHANGED)
    if code is None:
        raise WriterError("a depth image is no PNG")
    with np.errstate(divide="ignore"):
        depth = A / (code.astype(np.float64) - B)
    return np.where(code > 0, depth, 0.0).astype(np.float32)


def tags_png(maker: MessageParts, header: Message, sample: SemanticImage) -> Message:
    """Semantic tags, nothing lost."""
    return _compressed(maker, header, "mono8; png compressed", png_of(sample.tag, sample.sensor, _PNG))


def cloud_draco(maker: MessageParts, header: Message, sample: PointCloud) -> Message:
    """Points by Draco, ring after ring, positions in 14 bits; `DRACO_FIELDS` as generic attributes."""
    order = np.lexsort((sample.offset_ns, sample.ring))
    count = len(order)
    none = np.zeros(count, np.uint8)
    columns = (
        np.clip(np.rint(sample.intensity), 0, 255).astype(np.uint8),
        sample.ring.astype(np.uint8 if sample.ring.max(initial=0) < 256 else np.uint16),
        ((sample.offset_ns + 500) // 1000).astype(np.uint32),
        none if sample.tag is None else sample.tag,
        none.astype(np.uint32) if sample.instance is None else sample.instance,
    )
    data = b""
    if count:
        data = draco().encode(
            sample.points_xyz_m[order],
            quantization_bits=_DRACO_BITS,
            compression_level=5,
            preserve_order=True,
            generic_attributes={number: column[order][:, None] for number, column in enumerate(columns)},
        )
    nowhere = maker.pose(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))
    return maker.new(
        "foxglove_msgs/CompressedPointCloud",
        timestamp=header.stamp,
        frame_id=header.frame_id,
        pose=nowhere,
        data=np.frombuffer(data, np.uint8),
        format="draco",
    )


def columns_of_draco(data: bytes) -> dict[str, NDArray[Any]]:
    """Columns of a Draco cloud: x, y, z [m], and those of `DRACO_FIELDS` if it is one of ours.

    Raises:
        WriterError: the library is not installed.
    """
    if not data:
        return dict.fromkeys("xyz", np.zeros(0))
    found = draco().decode(data)
    columns = dict(zip("xyz", np.asarray(found.points, np.float64).T, strict=True))
    generic = {a["unique_id"]: a["data"].ravel() for a in found.attributes if a["attribute_type"] == _GENERIC}
    if len(generic) == len(DRACO_FIELDS):
        columns |= dict(zip(DRACO_FIELDS, (generic[number] for number in sorted(generic)), strict=True))
    return columns


@cache
def draco() -> Any:
    """The library that writes and reads Draco.

    Raises:
        WriterError: it is not installed.
    """
    try:
        import DracoPy
    except ImportError as error:
        raise WriterError(
            f"the topics 'compact' need DracoPy ({error}); pip install 'carlaloc-env[compact]'"
        ) from error
    return DracoPy


def _compressed(maker: MessageParts, header: Message, kind: str, data: bytes) -> Message:
    pixels = np.frombuffer(data, np.uint8)
    return maker.new("sensor_msgs/CompressedImage", header=header, format=kind, data=pixels)


CRF = 18
"""Quality of x264: pictures of a drive keep about 38 dB."""


class VideoEncoder:
    """One stream: Annex B, a keyframe with its parameter sets every second, no B-frames.

    Args:
        width_px: Width, even [px].
        height_px: Height, even [px].
        rate_hz: Pictures a second [Hz].
    """

    def __init__(self, width_px: int, height_px: int, rate_hz: float) -> None:
        # Imported here: profiles without video do without FFmpeg's libraries.
        import av

        period = round(rate_hz) or 1
        codec = av.CodecContext.create("libx264", "w")
        assert isinstance(codec, av.VideoCodecContext)
        codec.width, codec.height, codec.pix_fmt = width_px, height_px, "yuv420p"
        codec.framerate = Fraction(rate_hz).limit_denominator(1000)
        codec.time_base = 1 / codec.framerate
        # One thread: bytes must not depend on the machine's cores.
        codec.options = {
            "preset": "veryfast",
            "tune": "zerolatency",
            "crf": str(CRF),
            "x264-params": f"keyint={period}:min-keyint={period}:scenecut=0:repeat-headers=1:annexb=1:"
            "threads=1:colorprim=bt709:transfer=bt709:colormatrix=bt709",
        }
        self._codec, self._shape, self._count = codec, (height_px * 3 // 2, width_px), 0

    def encode(self, planes: bytes) -> bytes:
        """The next picture, from its planes in 4:2:0.

        Raises:
            ValueError: they are not of the stream's size.
        """
        import av

        frame = av.VideoFrame.from_ndarray(
            np.frombuffer(planes, np.uint8).reshape(self._shape), format="yuv420p"
        )
        frame.pts = self._count
        self._count += 1
        return b"".join(bytes(packet) for packet in self._codec.encode(frame))
