"""Estimates the size of a rig's streams in messages and files."""

from collections.abc import Collection, Iterator

from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import (
    DepthImage,
    Events,
    FlowImage,
    Image,
    NormalImage,
    PointCloud,
    Sample,
    SemanticImage,
)
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from recorder.writers.topic_profiles import profile_by_name

RETURNS = 0.9
"""Share of a LiDAR's rays that give a point."""
CAMERA_SAMPLES: dict[str, type[Sample]] = {
    "rgb": Image, "depth": DepthImage, "semantic": SemanticImage, "events": Events, "flow": FlowImage,
    "normal": NormalImage,
}  # fmt: skip
"""Samples of a camera's outputs."""
MESSAGE_BYTES = {
    "image_rgb8": 3.0, "image_mono8": 1.0, "image_32fc1": 4.0, "image_tags": 1.0, "image_32fc2": 8.0,
    "image_32fc3": 12.0, "image_instances": 4.0, "event_array": 5.0, "points": 22.0, "points_labelled": 27.0,
    "points_of_the_town": 22.0, "video": 0.05, "cloud_draco": 1.75, "depth_png": 0.11, "tags_png": 0.02,
}  # fmt: skip
"""Size of a pixel or point in a message [bytes]; the last four as in docs/formats.md, events assumed."""
PACKED = ("video", "cloud_draco", "depth_png", "tags_png")
"""Messages that no bag makes smaller."""
BAG_SHARES = {
    "rosbag1": 1.0, "rosbag1_lz4": 0.72, "rosbag1_bz2": 0.48, "rosbag2": 0.55, "rosbag2_sqlite3": 1.0,
}  # fmt: skip
"""Size of a bag as a share of its messages'; measured in Town03."""
FILE_BYTES: dict[str, dict[type[Sample], float]] = {
    "euroc": {Image: 0.35},
    "kitti": {Image: 1.0, PointCloud: 20.0},
    "dsec": {Events: 2.0, DepthImage: 0.2},
    "nuscenes": {Image: 0.2, PointCloud: 20.0},
    "colmap": {Image: 1.0, DepthImage: 0.6, SemanticImage: 0.02},
    "raw": {Image: 1.0, DepthImage: 1.9, FlowImage: 4.0, NormalImage: 6.0, Events: 1.8, PointCloud: 25.0},
}
"""Size of a pixel or point in the files of a format [bytes]; of EuRoC, KITTI's clouds and `raw` measured in
Town03; of DSEC, KITTI's pictures, flow and normals assumed."""


def pixels_hz(config: CameraConfig) -> float:
    """Pixels that a camera takes a second."""
    return config.pinhole.width_px * config.pinhole.height_px * config.rate_hz


def large_streams(rig: SensorRig) -> Iterator[tuple[type[Sample], str, float]]:
    """Kind, name, and pixels or points a second of each stream of cameras and LiDARs."""
    for config in rig.sensors:
        if isinstance(config, CameraConfig):
            for output in config.outputs:
                yield CAMERA_SAMPLES[output], f"{output}_{config.name}", pixels_hz(config)
        if isinstance(config, LidarConfig):
            for output in config.outputs:
                name = config.name if output == "cloud" else f"{config.name}_semantic"
                yield PointCloud, name, RETURNS * config.rays * config.rate_hz


def element_bytes(
    topics: str, format_name: str, kind: type[Sample], stream: str, streams: Collection[str]
) -> tuple[float, float]:
    """Size of a pixel or point of a stream in a format, before and after a bag packs it [bytes].

    Args:
        topics: Name of the profile of bags.
        format_name: Name of the format.
        kind: Kind of the stream's samples.
        stream: Name of the stream.
        streams: All streams of the rig.
    """
    if format_name not in BAG_SHARES:
        # Of a LiDAR's two clouds, these hold the one with labels.
        is_left_out = format_name in ("kitti", "nuscenes") and f"{stream}_semantic" in streams
        size = 0.0 if is_left_out else FILE_BYTES[format_name].get(kind, 0.0)
        return size, size
    profiles = [topics, *(["paper_seg"] if topics == "paper" else [])]
    routes = [route for p in profiles for route in profile_by_name(p).routes(kind, stream, streams)]
    sizes = [(route.message, MESSAGE_BYTES.get(route.message, 0.0)) for route in routes]
    packed = sum(size * (1.0 if message in PACKED else BAG_SHARES[format_name]) for message, size in sizes)
    return sum(size for _, size in sizes), packed
