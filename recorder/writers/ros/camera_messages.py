"""ROS messages of cameras: images, their calibration, events."""

from __future__ import annotations

import numpy as np

from carlaloc_env.samples import DepthImage, Events, FlowImage, Image, NormalImage, SemanticImage
from recorder.writers.base import grey
from recorder.writers.ros.message_parts import Message, MessageParts


def image_rgb8(maker: MessageParts, header: Message, sample: Image) -> Message:
    """Colour image."""
    return maker.image(header, sample.rgb, "rgb8")


def image_mono8(maker: MessageParts, header: Message, sample: Image) -> Message:
    """Brightness of a colour image."""
    return maker.image(header, grey(sample), "mono8")


def image_32fc1(maker: MessageParts, header: Message, sample: DepthImage) -> Message:
    """Planar depth [m]."""
    return maker.image(header, sample.depth_m, "32FC1")


def image_tags(maker: MessageParts, header: Message, sample: SemanticImage) -> Message:
    """Semantic tags."""
    return maker.image(header, sample.tag, "mono8")


def image_instances(maker: MessageParts, header: Message, sample: SemanticImage) -> Message:
    """Instance ids."""
    return maker.image(header, sample.instance.astype(np.int32), "32SC1")


def image_32fc2(maker: MessageParts, header: Message, sample: FlowImage) -> Message:
    """Flow, rightwards and downwards [px]."""
    return maker.image(header, sample.flow_px, "32FC2")


def image_32fc3(maker: MessageParts, header: Message, sample: NormalImage) -> Message:
    """Normals in the optical frame."""
    return maker.image(header, sample.normal, "32FC3")


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
