"""ROS messages of cameras: images, their calibration, events."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.samples import DepthImage, Events, Image
from recorder.writers.ros.message_parts import Message, MessageParts


def image_encoder(
    encoding: str, pixels_of: Callable[[Any], NDArray[Any]]
) -> Callable[[MessageParts, Message, Any], Message]:
    """Function that makes images of an encoding from an array of a sample."""
    return lambda maker, header, sample: maker.image(header, pixels_of(sample), encoding)


def depth_image(maker: MessageParts, header: Message, sample: DepthImage) -> Message:
    """Depth [m] by REP 117 and 118: +Inf for the sky and beyond the range, NaN where nothing is measured."""
    depth_m = np.where(sample.depth_m == 0.0, np.float32(np.inf), sample.depth_m)
    return maker.image(header, depth_m, "32FC1")


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
