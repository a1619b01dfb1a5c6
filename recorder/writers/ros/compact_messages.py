"""ROS messages of the profiles `compact`: video, depth and labels as PNG, clouds by Draco.

docs/formats.md gives the losses of each, and tests hold them.
"""

import struct
from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import DepthImage, Image, PointCloud, SemanticImage
from recorder.writers.base import png_of
from recorder.writers.ros.message_parts import Message, MessageParts

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
    cloud = draco().decode(data)
    columns = dict(zip("xyz", np.asarray(cloud.points, np.float64).T, strict=True))
    generic = {a["unique_id"]: a["data"].ravel() for a in cloud.attributes if a["attribute_type"] == _GENERIC}
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
            f"the topics 'compact' need DracoPy ({error}); pip install 'carlaloc[compact]'"
        ) from error
    return DracoPy


def _compressed(maker: MessageParts, header: Message, kind: str, data: bytes) -> Message:
    pixels = np.frombuffer(data, np.uint8)
    return maker.new("sensor_msgs/CompressedImage", header=header, format=kind, data=pixels)
