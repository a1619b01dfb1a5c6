"""Topic profiles: the topic and the message of each stream.

Size of a rig's streams in messages and files.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass

from carlaloc_env.core.errors import WriterError, unknown_name
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import (
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
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.ranging_config import LidarConfig


@dataclass(frozen=True, slots=True)
class TopicRule:
    """Topic and message of the samples of some streams."""

    sample: type[Sample]
    """Kind of sample."""
    stream: str
    """Name of the stream; a ``*`` stands for any text."""
    topic: str
    """Topic; ``{}`` is the text that the ``*`` matched."""
    message: str
    """Name of the function in `messages.ENCODERS`."""
    frame_id: str | None = None
    """Frame in the message's header; None: the sample's."""
    unless: str | None = None
    """Not written when the rig has this stream (with ``{}`` as above), which holds the same and more."""

    def match(self, stream: str) -> str | None:
        """Text that the ``*`` matches, or None if the rule is for other streams."""
        if "*" not in self.stream:
            return "" if stream == self.stream else None
        head, tail = self.stream.split("*", 1)
        fits = len(stream) >= len(head) + len(tail) and stream.startswith(head) and stream.endswith(tail)
        return stream[len(head) : len(stream) - len(tail)] if fits else None


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicRoute:
    """Topic, message and frame of a stream."""

    topic: str
    """Topic."""
    message: str
    """Name of the function in `messages.ENCODERS`."""
    frame_id: str | None
    """Frame in the header; None: the sample's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicProfile:
    """A set of rules and of topics that belong to no sensor."""

    name: str
    """Name of the profile."""
    rules: tuple[TopicRule, ...]
    """Rules; for each stream those of the first stream pattern that fits count."""
    tf_static: bool = True
    """Whether `/tf_static` is written."""
    clock: bool = True
    """Whether `/clock` is written."""

    def routes(
        self, kind: type[Sample], stream: str, streams: Collection[str] | None = None
    ) -> tuple[TopicRoute, ...]:
        """Topics and messages of a stream's samples; none if the profile leaves the stream out.

        Args:
            kind: Kind of sample.
            stream: Name of the stream.
            streams: All streams of the rig; None: unknown, nothing is left out.
        """
        found: list[TopicRoute] = []
        pattern: str | None = None
        for rule in self.rules:
            part = rule.match(stream) if rule.sample is kind and pattern in (None, rule.stream) else None
            if part is None:
                continue
            pattern = rule.stream
            if rule.unless is None or rule.unless.format(part) not in (streams or ()):
                found.append(
                    TopicRoute(topic=rule.topic.format(part), message=rule.message, frame_id=rule.frame_id)
                )
        return tuple(found)

    def topic(self, kind: type[Sample], stream: str) -> str:
        """First topic of a stream, or ``/`` + its name if the profile does not hold it."""
        routes = self.routes(kind, stream)
        return routes[0].topic if routes else f"/{stream}"

    def frame(self, kind: type[Sample], stream: str, frame_id: str) -> str:
        """Frame in the headers of a stream whose samples have the frame `frame_id`."""
        routes = self.routes(kind, stream)
        return routes[0].frame_id or frame_id if routes else frame_id


STANDARD = TopicProfile(
    name="standard",
    rules=(
        TopicRule(Image, "rgb_*", "/camera/{}/image_raw", "image_rgb8"),
        TopicRule(Image, "rgb_*", "/camera/{}/camera_info", "camera_info"),
        TopicRule(DepthImage, "depth_*", "/camera/{}/depth", "image_32fc1"),
        TopicRule(SemanticImage, "semantic_*", "/camera/{}/semantic", "image_tags"),
        TopicRule(FlowImage, "flow_*", "/camera/{}/flow", "image_32fc2"),
        TopicRule(NormalImage, "normal_*", "/camera/{}/normal", "image_32fc3"),
        TopicRule(PointCloud, "*_semantic", "/{}/points", "points_labelled"),
        TopicRule(PointCloud, "*", "/{}/points", "points", unless="{}_semantic"),
        TopicRule(RadarScan, "radar_*", "/radar/{}/points", "radar_points"),
        TopicRule(RadarScan, "radar_*", "/radar/{}/scan", "radar_scan"),
        TopicRule(Imu, "*", "/{}/data", "imu"),
        TopicRule(GnssFix, "*", "/{}/fix", "nav_sat_fix"),
        TopicRule(Speed, "*", "/{}", "twist"),
        TopicRule(WheelTicks, "*", "/{}/joint_states", "wheel_joints"),
        TopicRule(Odometry, "*", "/ground_truth/odometry", "odometry"),
        TopicRule(Odometry, "*", "/ground_truth/acceleration", "acceleration"),
        TopicRule(ObjectList, "*", "/ground_truth/objects", "objects"),
        TopicRule(ObjectList, "*", "/ground_truth/object_table", "object_table"),
    ),
)
"""Every sensor but the event cameras, with transforms and clock."""

FULL = TopicProfile(
    name="full",
    rules=(
        *STANDARD.rules,
        TopicRule(Events, "events_*", "/camera/{}/events", "event_array"),
        TopicRule(SemanticImage, "semantic_*", "/camera/{}/instance", "image_instances"),
    ),
)
"""`STANDARD`, events (up to 0.5 GB a second of driving) and images of instance ids, 3.7 MB each."""

PAPER = TopicProfile(
    name="paper",
    rules=(
        TopicRule(Image, "rgb_left", "/cam0_raw", "image_mono8", frame_id="cam_left"),
        TopicRule(Image, "rgb_right", "/cam1_raw", "image_mono8", frame_id="cam_right"),
        TopicRule(PointCloud, "lidar", "/velodyne", "points", frame_id="laser"),
        TopicRule(Imu, "imu", "/imu", "imu", frame_id="imu"),
    ),
    tf_static=False,
    clock=False,
)
"""Topics and frames of the CARLA-Loc release; the cloud has ring and time beside its four fields."""

SLAM = TopicProfile(
    name="slam",
    rules=(
        TopicRule(Image, "rgb_*", "/camera/{}/image_raw", "image_mono8"),
        TopicRule(Image, "rgb_*", "/camera/{}/camera_info", "camera_info"),
        TopicRule(PointCloud, "lidar", "/lidar/points", "points"),
        TopicRule(Imu, "*", "/{}/data", "imu"),
        TopicRule(GnssFix, "*", "/{}/fix", "nav_sat_fix"),
        TopicRule(Odometry, "*", "/ground_truth/odometry", "odometry"),
    ),
)
"""For SLAM systems: grey images and the plain cloud, a third of the size of `STANDARD`."""

PAPER_SEG = TopicProfile(
    name="paper_seg",
    rules=(
        TopicRule(PointCloud, "lidar_semantic", "/velodyne", "points_of_the_town", frame_id="laser"),
        TopicRule(Imu, "imu", "/imu", "imu", frame_id="imu"),
    ),
    tf_static=False,
    clock=False,
)
"""The release's ``LIOseg``: the cloud without walkers and vehicles, and the IMU."""

_COMPACT_CLOUDS = (
    TopicRule(PointCloud, "*_semantic", "/{}/draco", "cloud_draco"),
    TopicRule(PointCloud, "*", "/{}/draco", "cloud_draco", unless="{}_semantic"),
)

COMPACT = TopicProfile(
    name="compact",
    rules=(
        TopicRule(Image, "rgb_*", "/camera/{}/video", "video"),
        TopicRule(Image, "rgb_*", "/camera/{}/camera_info", "camera_info"),
        *_COMPACT_CLOUDS,
        *(rule for rule in STANDARD.rules if rule.sample in (Imu, GnssFix, Speed, WheelTicks)),
        TopicRule(Odometry, "*", "/ground_truth/odometry", "odometry"),
        TopicRule(ObjectList, "*", "/ground_truth/object_table", "object_table"),
    ),
)
"""Video, clouds by Draco, IMU, truth: a few hours fit on a laptop; docs/formats.md gives the losses."""

COMPACT_FULL = TopicProfile(
    name="compact_full",
    rules=(
        *COMPACT.rules,
        TopicRule(DepthImage, "depth_*", "/camera/{}/depth/compressedDepth", "depth_png"),
        TopicRule(SemanticImage, "semantic_*", "/camera/{}/semantic/compressed", "tags_png"),
        TopicRule(RadarScan, "radar_*", "/radar/{}/points", "radar_points"),
    ),
)
"""`COMPACT` with depth and semantics as PNG, and the radars."""

PROFILES = {
    profile.name: profile for profile in (STANDARD, PAPER, PAPER_SEG, SLAM, FULL, COMPACT, COMPACT_FULL)
}
"""All profiles by name."""


def profile_by_name(name: str) -> TopicProfile:
    """The profile of a name.

    Raises:
        WriterError: there is none; the message names the nearest.
    """
    if name not in PROFILES:
        raise WriterError(unknown_name("topic profile", name, PROFILES))
    return PROFILES[name]


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
