"""All topic profiles by name."""

from collections.abc import Iterable
from dataclasses import replace

from carlaloc_env.core.errors import WriterError, unknown_name
from carlaloc_env.core.own_code import own_object
from carlaloc_env.samples import (
    DepthImage,
    Events,
    FlowImage,
    GnssFix,
    GnssRaw,
    Image,
    Imu,
    NormalImage,
    ObjectList,
    Odometry,
    PointCloud,
    RadarScan,
    SemanticImage,
    Speed,
    WheelTicks,
)
from carlaloc_env.sensors.base import SensorConfig
from recorder.writers.driver_layouts import driver_rules
from recorder.writers.topics import TopicProfile, TopicRule

_RAW_GNSS = (
    TopicRule(GnssRaw, "*_raw", "/ublox_driver/range_meas", "gnss_measurements"),
    TopicRule(GnssRaw, "*_raw", "/ublox_driver/ephem", "gnss_ephemeris"),
    TopicRule(GnssRaw, "*_raw", "/ublox_driver/iono_params", "gnss_ionosphere"),
)
"""Topics that GVINS reads."""
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
        *_RAW_GNSS,
        TopicRule(Speed, "*", "/{}", "twist"),
        TopicRule(WheelTicks, "*", "/{}/joint_states", "wheel_joints"),
        TopicRule(Odometry, "*", "/ground_truth/odometry", "odometry"),
        TopicRule(Odometry, "*", "/ground_truth/acceleration", "acceleration"),
        TopicRule(ObjectList, "*", "/ground_truth/objects", "objects"),
        TopicRule(ObjectList, "*", "/ground_truth/object_table", "object_table"),
    ),
    drivers=True,
)
"""Every sensor but the event cameras, with the sensors' transforms."""
FULL = TopicProfile(
    name="full",
    rules=(
        *STANDARD.rules,
        TopicRule(Events, "events_*", "/camera/{}/events", "event_array"),
        TopicRule(SemanticImage, "semantic_*", "/camera/{}/instance", "image_instances"),
    ),
    drivers=True,
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
)
"""Topics and frames of the CARLA-Loc release; the cloud has ring and time beside its four fields."""
SLAM = TopicProfile(
    name="slam",
    rules=(
        TopicRule(Image, "rgb_*", "/camera/{}/image_raw", "image_mono8"),
        TopicRule(Image, "rgb_*", "/camera/{}/camera_info", "camera_info"),
        TopicRule(PointCloud, "*_semantic", "/{}/points", "points", unless="{}"),
        TopicRule(PointCloud, "*", "/{}/points", "points"),
        TopicRule(Imu, "*", "/{}/data", "imu"),
        TopicRule(GnssFix, "*", "/{}/fix", "nav_sat_fix"),
        *_RAW_GNSS,
        TopicRule(Odometry, "*", "/ground_truth/odometry", "odometry"),
    ),
    drivers=True,
)
"""For SLAM systems: grey images and the plain cloud, a third of the size of `STANDARD`."""
PAPER_SEG = TopicProfile(
    name="paper_seg",
    rules=(
        TopicRule(PointCloud, "lidar_semantic", "/velodyne", "points_of_the_town", frame_id="laser"),
        TopicRule(Imu, "imu", "/imu", "imu", frame_id="imu"),
    ),
    tf_static=False,
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
        *(rule for rule in STANDARD.rules if rule.sample in (Imu, GnssFix, GnssRaw, Speed, WheelTicks)),
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
TRUTH_TF = TopicRule(Odometry, "*", "/tf", "truth_tf")
"""The car's true pose as a transform; in no profile, since SLAM systems publish their own."""


def profile_by_name(name: str) -> TopicProfile:
    """The profile of a name, or that of a user's file: ``mine.py:PROFILE``.

    Raises:
        WriterError: there is none; the message names the nearest.
        ConfigError: the file has no such profile.
    """
    if name in PROFILES:
        return PROFILES[name]
    if ":" in name:
        return own_object(name, TopicProfile)
    raise WriterError(unknown_name("topic profile", name, PROFILES) + ", or FILE.py:PROFILE")


def profile_for(name: str, sensors: Iterable[SensorConfig]) -> TopicProfile:
    """The profile of a name with the drivers' messages of some sensors, where it has such.

    Raises:
        WriterError: there is none; the message names the nearest.
        ConfigError: the file has no such profile.
    """
    profile = profile_by_name(name)
    return replace(profile, rules=(*profile.rules, *driver_rules(sensors))) if profile.drivers else profile
