"""Topic, frame and encoding of drivers' messages: of LiDARs by their `layout`, and of the IMUs inside them.

Topics, frames and units are the defaults of velodyne_pointcloud, ouster-ros, HesaiLidar_ROS_2.0, rslidar_sdk,
livox_ros_driver(2) and, of 2019 to 2021, ouster_example; those of `aeva` are of HeLiPR's file player.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

from carlaloc_env.core.array_types import Array
from carlaloc_env.samples import Imu, PointCloud
from carlaloc_env.sensors.base import SensorConfig
from carlaloc_env.sensors.imu import ImuConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from recorder.writers.topics import TopicRule

_LIVOX = "/livox/lidar", "livox_frame"
_CLOUDS = {
    "velodyne": ("/velodyne_points", "velodyne", "points"),
    "ouster": ("/ouster/points", "os_lidar", "points_ouster"),
    "ouster_2021": ("/os_cloud_node/points", "os_sensor", "points_ouster_2021"),
    "hesai": ("/lidar_points", "hesai_lidar", "points_hesai"),
    "robosense": ("/rslidar_points", "rslidar", "points_robosense"),
    "livox": (*_LIVOX, "livox"),
    "livox_ros_driver": (*_LIVOX, "livox_1"),
    "livox_ros_driver2": (*_LIVOX, "livox_2"),
    "livox_points": (*_LIVOX, "points_livox"),
    "aeva": ("/aeva/points", "aeva", "points_aeva"),
}
"""Topic, frame and message of clouds; the message is the name of a function in `messages.ENCODERS`."""
_IMUS = {
    "ouster": ("/ouster/imu", "os_imu", "imu"),
    "ouster_2021": ("/os_cloud_node/imu", "os_imu", "imu"),
    "hesai": ("/lidar_imu", "hesai_lidar", "imu"),
    "robosense": ("/rslidar_imu_data", "rslidar", "imu_g"),
    "livox": ("/livox/imu", "livox_frame", "imu_g"),
}
"""The same of IMUs; those of RoboSense and Livox state accelerations in g."""


def driver_rules(sensors: Iterable[SensorConfig]) -> tuple[TopicRule, ...]:
    """Rules for the drivers' messages of a rig's sensors that have a layout.

    Topics and frames that two sensors of a kind would share get the sensor's name in front, and so do frames
    that are another sensor's own.
    """
    sensors = tuple(sensors)
    rules: list[TopicRule] = []
    for kind in (LidarConfig, ImuConfig):
        mine = {s.name: rule for s in sensors if isinstance(s, kind) and (rule := _rule_of(s)) is not None}
        topics = Counter(rule.topic for rule in mine.values())
        frames = Counter(rule.frame_id for rule in mine.values())
        for name, rule in mine.items():
            topic, frame = rule.topic, rule.frame_id
            if topics[topic] > 1:
                topic = f"/{name}{topic}"
            if frames[frame] > 1 or frame in {sensor.frame_id for sensor in sensors if sensor.name != name}:
                frame = f"{name}/{frame}"
            rules.append(replace(rule, topic=topic, frame_id=frame))
            if kind is LidarConfig:
                # A LiDAR without a plain cloud has the labelled one alone.
                rules.append(replace(rules[-1], stream=f"{name}_semantic", unless=name))
    return tuple(rules)


def driver_frames(sensors: Iterable[SensorConfig]) -> dict[str, Array]:
    """Maps of the frames in drivers' messages to `base_link`, each (4, 4).

    Where a LiDAR and its IMU have the same frame, as Livox's have, it is the LiDAR's.
    """
    sensors = tuple(sensors)
    rules = {(rule.sample, rule.stream): rule for rule in driver_rules(sensors)}
    kinds = ((ImuConfig, Imu), (LidarConfig, PointCloud))
    return {
        str(rules[sample, sensor.name].frame_id): sensor.mount.T_base_sensor
        for kind, sample in kinds
        for sensor in sensors
        if isinstance(sensor, kind) and (sample, sensor.name) in rules
    }


def _rule_of(sensor: LidarConfig | ImuConfig) -> TopicRule | None:
    if sensor.layout is None:
        return None
    is_lidar = isinstance(sensor, LidarConfig)
    topic, frame, message = (_CLOUDS if is_lidar else _IMUS)[sensor.layout]
    if isinstance(sensor, LidarConfig) and sensor.time_unit == "us":
        message = "points_us"
    sample = PointCloud if is_lidar else Imu
    return TopicRule(sample, sensor.name, topic, message, frame_id=frame, beside=True)
