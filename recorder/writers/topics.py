"""Which stream goes to which topic as which message: profiles as data."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from carlaloc_env.core.errors import WriterError, unknown_name
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


@dataclass(frozen=True, slots=True, kw_only=True)
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
    """Frame in the message's header, if not the sample's own."""
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
    """Topic, message and frame of one stream."""

    topic: str
    """Topic."""
    message: str
    """Name of the function in `messages.ENCODERS`."""
    frame_id: str | None
    """Frame in the header, if not the sample's own."""


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
        """Where the samples of a stream go; nowhere if the profile does not hold it.

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
        """Frame in the headers of a stream whose own frame is `frame_id`."""
        routes = self.routes(kind, stream)
        return routes[0].frame_id or frame_id if routes else frame_id


STANDARD = TopicProfile(
    name="standard",
    rules=(
        TopicRule(sample=Image, stream="rgb_*", topic="/camera/{}/image_raw", message="image_rgb8"),
        TopicRule(sample=Image, stream="rgb_*", topic="/camera/{}/camera_info", message="camera_info"),
        TopicRule(sample=DepthImage, stream="depth_*", topic="/camera/{}/depth", message="image_32fc1"),
        TopicRule(
            sample=SemanticImage, stream="semantic_*", topic="/camera/{}/semantic", message="image_tags"
        ),
        TopicRule(sample=FlowImage, stream="flow_*", topic="/camera/{}/flow", message="image_32fc2"),
        TopicRule(sample=NormalImage, stream="normal_*", topic="/camera/{}/normal", message="image_32fc3"),
        TopicRule(sample=PointCloud, stream="*_semantic", topic="/{}/points", message="points_labelled"),
        TopicRule(sample=PointCloud, stream="*", topic="/{}/points", message="points", unless="{}_semantic"),
        TopicRule(sample=RadarScan, stream="radar_*", topic="/radar/{}/points", message="radar_points"),
        TopicRule(sample=RadarScan, stream="radar_*", topic="/radar/{}/scan", message="radar_scan"),
        TopicRule(sample=Imu, stream="*", topic="/{}/data", message="imu"),
        TopicRule(sample=GnssFix, stream="*", topic="/{}/fix", message="nav_sat_fix"),
        TopicRule(sample=Speed, stream="*", topic="/{}", message="twist"),
        TopicRule(sample=WheelTicks, stream="*", topic="/{}/joint_states", message="wheel_joints"),
        TopicRule(sample=CanState, stream="*", topic="/{}/frames", message="can_steering"),
        TopicRule(sample=CanState, stream="*", topic="/{}/frames", message="can_wheels"),
        TopicRule(sample=CanState, stream="*", topic="/{}/frames", message="can_pedals"),
        TopicRule(sample=Odometry, stream="*", topic="/ground_truth/odometry", message="odometry"),
        TopicRule(sample=Odometry, stream="*", topic="/ground_truth/acceleration", message="acceleration"),
        TopicRule(sample=ObjectList, stream="*", topic="/ground_truth/objects", message="objects"),
        TopicRule(sample=ObjectList, stream="*", topic="/ground_truth/object_table", message="object_table"),
    ),
)
"""Every sensor but the event cameras, with transforms and clock."""

FULL = TopicProfile(
    name="full",
    rules=(
        *STANDARD.rules,
        TopicRule(sample=Events, stream="events_*", topic="/camera/{}/events", message="event_array"),
        TopicRule(
            sample=SemanticImage, stream="semantic_*", topic="/camera/{}/instance", message="image_instances"
        ),
    ),
)
"""`STANDARD`, events (up to 0.5 GB a second of driving) and images of instance ids, 3.7 MB each."""

PAPER = TopicProfile(
    name="paper",
    rules=(
        TopicRule(
            sample=Image, stream="rgb_left", topic="/cam0_raw", message="image_mono8", frame_id="cam_left"
        ),
        TopicRule(
            sample=Image, stream="rgb_right", topic="/cam1_raw", message="image_mono8", frame_id="cam_right"
        ),
        TopicRule(sample=PointCloud, stream="lidar", topic="/velodyne", message="points", frame_id="laser"),
        TopicRule(sample=Imu, stream="imu", topic="/imu", message="imu", frame_id="imu"),
    ),
    tf_static=False,
    clock=False,
)
"""Topics and frames of the CARLA-Loc release; the cloud has ring and time beside its four fields."""

SLAM = TopicProfile(
    name="slam",
    rules=(
        TopicRule(sample=Image, stream="rgb_*", topic="/camera/{}/image_raw", message="image_mono8"),
        TopicRule(sample=Image, stream="rgb_*", topic="/camera/{}/camera_info", message="camera_info"),
        TopicRule(sample=PointCloud, stream="lidar", topic="/lidar/points", message="points"),
        TopicRule(sample=Imu, stream="*", topic="/{}/data", message="imu"),
        TopicRule(sample=GnssFix, stream="*", topic="/{}/fix", message="nav_sat_fix"),
        TopicRule(sample=Odometry, stream="*", topic="/ground_truth/odometry", message="odometry"),
    ),
)
"""What SLAM systems read: grey images and the plain cloud, a third of the size of `STANDARD`."""

PAPER_SEG = TopicProfile(
    name="paper_seg",
    rules=(
        TopicRule(
            sample=PointCloud,
            stream="lidar_semantic",
            topic="/velodyne",
            message="points_of_the_town",
            frame_id="laser",
        ),
        TopicRule(sample=Imu, stream="imu", topic="/imu", message="imu", frame_id="imu"),
    ),
    tf_static=False,
    clock=False,
)
"""The release's ``LIOseg``: the cloud without walkers and vehicles, and the IMU."""

_COMPACT_CLOUDS = (
    TopicRule(sample=PointCloud, stream="*_semantic", topic="/{}/draco", message="cloud_draco"),
    TopicRule(sample=PointCloud, stream="*", topic="/{}/draco", message="cloud_draco", unless="{}_semantic"),
)

COMPACT = TopicProfile(
    name="compact",
    rules=(
        TopicRule(sample=Image, stream="rgb_*", topic="/camera/{}/video", message="video"),
        TopicRule(sample=Image, stream="rgb_*", topic="/camera/{}/camera_info", message="camera_info"),
        *_COMPACT_CLOUDS,
        *(rule for rule in STANDARD.rules if rule.sample in (Imu, GnssFix, Speed, WheelTicks, CanState)),
        TopicRule(sample=Odometry, stream="*", topic="/ground_truth/odometry", message="odometry"),
        TopicRule(sample=ObjectList, stream="*", topic="/ground_truth/object_table", message="object_table"),
    ),
)
"""Video, clouds by Draco, IMU, truth: a few hours fit on a laptop; what is lost is told in numbers."""

COMPACT_FULL = TopicProfile(
    name="compact_full",
    rules=(
        *COMPACT.rules,
        TopicRule(
            sample=DepthImage, stream="depth_*", topic="/camera/{}/depth/compressedDepth", message="depth_png"
        ),
        TopicRule(
            sample=SemanticImage,
            stream="semantic_*",
            topic="/camera/{}/semantic/compressed",
            message="tags_png",
        ),
        TopicRule(sample=RadarScan, stream="radar_*", topic="/radar/{}/points", message="radar_points"),
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
