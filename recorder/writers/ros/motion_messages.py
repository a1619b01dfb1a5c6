"""ROS messages of the motion of the car and others: inertial, satellite, wheels, truth."""

import numpy as np

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import GRAVITY_MPS2
from carlaloc_env.samples import GnssFix, Imu, ObjectList, Odometry, Speed, WheelTicks
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.timeline.vehicle_track import WHEELS
from recorder.writers.ros.message_parts import MAP_FRAME, Message, MessageParts

_CLASSES = {
    Tag.PEDESTRIAN: 4, Tag.RIDER: 5, Tag.BICYCLE: 5, Tag.CAR: 6, Tag.TRUCK: 7, Tag.MOTORCYCLE: 8, Tag.BUS: 9,
    Tag.TRAIN: 9,
}  # fmt: skip
"""derived_object_msgs/Object's classification of semantic tags."""


def imu(maker: MessageParts, header: Message, sample: Imu) -> Message:
    """Specific force and body rate with their noise; the attitude where the sensor measures it."""
    covariance = np.eye(3).reshape(-1) * sample.orientation_noise_rad**2
    if sample.quat_xyzw is None:
        covariance = np.zeros(9)
        covariance[0] = -1.0  # sensor_msgs/Imu: "no orientation estimate"
    force_covariance, rate_covariance = maker.imu_covariances(sample.sensor)
    quat = sample.quat_xyzw if sample.quat_xyzw is not None else np.array([0.0, 0.0, 0.0, 1.0])
    return maker.new(
        "sensor_msgs/Imu",
        header=header,
        orientation=maker.quaternion(quat),
        orientation_covariance=covariance,
        angular_velocity=maker.vector(sample.angular_rate_radps),
        angular_velocity_covariance=rate_covariance,
        linear_acceleration=maker.vector(sample.specific_force_mps2),
        linear_acceleration_covariance=force_covariance,
    )


def imu_g(maker: MessageParts, header: Message, sample: Imu) -> Message:
    """The same with the specific force in g."""
    message = imu(maker, header, sample)
    message.linear_acceleration = maker.vector(sample.specific_force_mps2 / GRAVITY_MPS2)
    message.linear_acceleration_covariance = message.linear_acceleration_covariance / GRAVITY_MPS2**2
    return message


def nav_sat_fix(maker: MessageParts, header: Message, sample: GnssFix) -> Message:
    """Position on the Earth; its covariance is east, north, up."""
    # A base station's corrections are an augmentation from the ground (STATUS_GBAS_FIX).
    level = {"none": -1, "single": 0, "float": 2, "fixed": 2}[sample.solution if sample.has_fix else "none"]
    status = maker.new("sensor_msgs/NavSatStatus", status=level, service=1)
    covariance = sample.covariance_enu_m2
    diagonal = not np.any(covariance - np.diag(np.diag(covariance)))
    return maker.new(
        "sensor_msgs/NavSatFix",
        header=header,
        status=status,
        latitude=sample.latitude_deg,
        longitude=sample.longitude_deg,
        altitude=sample.altitude_m,
        position_covariance=np.ascontiguousarray(covariance).reshape(-1),
        position_covariance_type=(2 if diagonal else 3) if sample.has_fix else 0,
    )


def twist(maker: MessageParts, header: Message, sample: Speed) -> Message:
    """Forward speed in the axes of the car."""
    linear = maker.vector(np.array([sample.speed_mps, 0.0, 0.0]))
    twist = maker.new("geometry_msgs/Twist", linear=linear, angular=maker.vector(np.zeros(3)))
    return maker.new("geometry_msgs/TwistStamped", header=header, twist=twist)


def wheel_joints(maker: MessageParts, header: Message, sample: WheelTicks) -> Message:
    """Angles are whole ticks."""
    return maker.new(
        "sensor_msgs/JointState",
        header=header,
        name=[f"wheel_{name}" for name in WHEELS],
        position=sample.ticks * (2.0 * np.pi / sample.ticks_per_turn),
        velocity=sample.rate_radps,
        effort=np.zeros(0),
    )


def objects(maker: MessageParts, header: Message, sample: ObjectList) -> Message:
    """Boxes in the world; the twist is in world axes, as CARLA's ROS bridge has it."""
    nothing = maker.vector(np.zeros(3))
    still = maker.new("geometry_msgs/Accel", linear=nothing, angular=nothing)
    no_polygon = maker.new("geometry_msgs/Polygon", points=[])
    # ROS 2's primitive has another polygon, for prisms.
    extra = {"polygon": no_polygon} if "polygon" in maker.fields_of("shape_msgs/SolidPrimitive") else {}
    objects = [
        maker.new(
            "derived_object_msgs/Object",
            header=header,
            id=int(sample.id[k]),
            detection_level=1,
            object_classified=True,
            pose=maker.pose(sample.position_m[k], quat),
            twist=maker.new(
                "geometry_msgs/Twist",
                linear=maker.vector(sample.velocity_mps[k]),
                angular=maker.vector(np.array([0.0, 0.0, sample.yaw_rate_radps[k]])),
            ),
            accel=still,
            polygon=no_polygon,
            shape=maker.new("shape_msgs/SolidPrimitive", type=1, dimensions=sample.size_m[k].copy(), **extra),
            classification=_CLASSES.get(Tag(int(sample.tag[k])), 0),
            classification_certainty=255,
            classification_age=0,
        )
        for k, quat in enumerate(sample.quat_xyzw)
    ]
    return maker.new("derived_object_msgs/ObjectArray", header=header, objects=objects)


def acceleration(maker: MessageParts, header: Message, sample: Odometry) -> Message:
    """Acceleration in the axes of the frame itself, without gravity."""
    turn = transforms.quat_conjugate(sample.quat_xyzw)
    linear = maker.vector(transforms.quat_rotate(turn, sample.acceleration_world_mps2))
    accel = maker.new("geometry_msgs/Accel", linear=linear, angular=maker.vector(np.zeros(3)))
    return maker.new("geometry_msgs/AccelStamped", header=header, accel=accel)


def odometry(maker: MessageParts, header: Message, sample: Odometry) -> Message:
    """The pose is in the header's frame, the twist in the child's (nav_msgs/Odometry)."""
    velocity = transforms.quat_rotate(transforms.quat_conjugate(sample.quat_xyzw), sample.velocity_world_mps)
    twist = maker.new(
        "geometry_msgs/Twist",
        linear=maker.vector(velocity),
        angular=maker.vector(sample.angular_rate_radps),
    )
    header.frame_id = MAP_FRAME
    return maker.new(
        "nav_msgs/Odometry",
        header=header,
        child_frame_id=sample.frame_id,
        pose=maker.new(
            "geometry_msgs/PoseWithCovariance",
            pose=maker.pose(sample.position_m, sample.quat_xyzw),
            covariance=np.zeros(36),
        ),
        twist=maker.new("geometry_msgs/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
    )


def truth_tf(maker: MessageParts, header: Message, sample: Odometry) -> Message:
    """The true pose as a transform, from the car's frame to `map`."""
    header.frame_id = MAP_FRAME
    transform = maker.transform(header, sample.frame_id, sample.position_m, sample.quat_xyzw)
    return maker.new("tf2_msgs/TFMessage", transforms=[transform])
