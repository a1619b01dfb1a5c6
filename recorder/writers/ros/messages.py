"""ROS messages of samples: a function per kind, for ROS 1 and ROS 2 alike."""

from collections.abc import Callable
from typing import Any

import numpy as np

from carlaloc_env.samples import Sample
from recorder.writers.base import grey
from recorder.writers.ros import (
    camera_messages,
    compact_messages,
    driver_messages,
    gnss_messages,
    motion_messages,
    point_messages,
)
from recorder.writers.ros.message_parts import MAP_FRAME, Message, MessageParts

ENCODERS: dict[str, tuple[str, Callable[[MessageParts, Message, Any], Message]]] = {
    "image_rgb8": ("sensor_msgs/msg/Image", camera_messages.image_encoder("rgb8", lambda s: s.rgb)),
    "image_mono8": ("sensor_msgs/msg/Image", camera_messages.image_encoder("mono8", grey)),
    "image_32fc1": ("sensor_msgs/msg/Image", camera_messages.depth_image),
    "image_tags": ("sensor_msgs/msg/Image", camera_messages.image_encoder("mono8", lambda s: s.tag)),
    "image_32fc2": ("sensor_msgs/msg/Image", camera_messages.image_encoder("32FC2", lambda s: s.flow_px)),
    "image_32fc3": ("sensor_msgs/msg/Image", camera_messages.image_encoder("32FC3", lambda s: s.normal)),
    "event_array": ("dvs_msgs/msg/EventArray", camera_messages.event_array),
    "camera_info": ("sensor_msgs/msg/CameraInfo", camera_messages.camera_info),
    "points": ("sensor_msgs/msg/PointCloud2", point_messages.points),
    "points_labelled": ("sensor_msgs/msg/PointCloud2", point_messages.points_labelled),
    "points_us": ("sensor_msgs/msg/PointCloud2", point_messages.points_us),
    "points_ouster": ("sensor_msgs/msg/PointCloud2", driver_messages.points_ouster),
    "points_ouster_2021": ("sensor_msgs/msg/PointCloud2", driver_messages.points_ouster_2021),
    "points_hesai": ("sensor_msgs/msg/PointCloud2", driver_messages.points_hesai),
    "points_robosense": ("sensor_msgs/msg/PointCloud2", driver_messages.points_robosense),
    "points_aeva": ("sensor_msgs/msg/PointCloud2", driver_messages.points_aeva),
    "points_livox": ("sensor_msgs/msg/PointCloud2", driver_messages.points_livox),
    "livox": (driver_messages.LIVOX_TYPE, driver_messages.livox),
    "livox_1": (driver_messages.LIVOX_TYPE.replace("driver2", "driver"), driver_messages.livox),
    "livox_2": (driver_messages.LIVOX_TYPE, driver_messages.livox),
    "points_of_the_town": ("sensor_msgs/msg/PointCloud2", point_messages.points_of_the_town),
    "video": ("foxglove_msgs/msg/CompressedVideo", compact_messages.video),
    "depth_png": ("sensor_msgs/msg/CompressedImage", compact_messages.depth_png),
    "tags_png": ("sensor_msgs/msg/CompressedImage", compact_messages.tags_png),
    "cloud_draco": ("foxglove_msgs/msg/CompressedPointCloud", compact_messages.cloud_draco),
    "radar_points": ("sensor_msgs/msg/PointCloud2", point_messages.radar_points),
    "radar_scan": ("radar_msgs/msg/RadarScan", point_messages.radar_scan),
    "imu": ("sensor_msgs/msg/Imu", motion_messages.imu),
    "imu_g": ("sensor_msgs/msg/Imu", motion_messages.imu_g),
    "nav_sat_fix": ("sensor_msgs/msg/NavSatFix", motion_messages.nav_sat_fix),
    "gnss_measurements": ("gnss_comm/msg/GnssMeasMsg", gnss_messages.measurements),
    "gnss_ephemeris": ("gnss_comm/msg/GnssEphemMsg", gnss_messages.ephemeris),
    "gnss_ionosphere": ("gnss_comm/msg/StampedFloat64Array", gnss_messages.ionosphere),
    "twist": ("geometry_msgs/msg/TwistStamped", motion_messages.twist),
    "wheel_joints": ("sensor_msgs/msg/JointState", motion_messages.wheel_joints),
    "objects": ("derived_object_msgs/msg/ObjectArray", motion_messages.objects),
    "object_table": ("sensor_msgs/msg/PointCloud", point_messages.object_table),
    "image_instances": (
        "sensor_msgs/msg/Image",
        camera_messages.image_encoder("32SC1", lambda s: s.instance.astype(np.int32)),
    ),
    "acceleration": ("geometry_msgs/msg/AccelStamped", motion_messages.acceleration),
    "odometry": ("nav_msgs/msg/Odometry", motion_messages.odometry),
    "truth_tf": ("tf2_msgs/msg/TFMessage", motion_messages.truth_tf),
}
"""Message type and function of every encoding of a sample, by name."""


def message_type(encoder: str, *, ros1: bool) -> str:
    """Message type of an encoder in `ENCODERS`; Livox's package is the one that a version of ROS uses."""
    name = "livox_1" if encoder == "livox" and ros1 else encoder
    return ENCODERS[name][0]


class MessageMaker(MessageParts):
    """Makes messages of samples with the types of a type store."""

    def make(self, encoder: str, sample: Sample, topic: str, frame_id: str | None = None) -> Message:
        """Message of a sample by the name of its encoder in `ENCODERS`."""
        own_frame = MAP_FRAME if sample.frame_id == "world" else sample.frame_id
        header = self.header(sample.stamp_ns, frame_id or own_frame, topic)
        return ENCODERS[encoder][1](self, header, sample)
