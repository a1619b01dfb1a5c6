"""Bags with poses, of every type of message that holds them."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Bag1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Bag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from recorder.evaluation.trajectory import Trajectory

ODOMETRY, PATH, TF = "nav_msgs/msg/Odometry", "nav_msgs/msg/Path", "tf2_msgs/msg/TFMessage"
POSES = (
    ODOMETRY,
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped",
)
Entry = tuple[str, str, int, Any]
"""Topic, type, time of recording [ns], message."""


class Messages:
    """Makes messages of one type store."""

    def __init__(self, *, ros2: bool) -> None:
        self.ros2 = ros2
        self.store = get_typestore(Stores.ROS2_HUMBLE if ros2 else Stores.ROS1_NOETIC)
        if TF not in self.store.types:
            self.store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
        self.make = self.store.types

    def header(self, stamp_ns: int, frame: str = "map") -> Any:
        stamp = self.make["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
        return self.make["std_msgs/msg/Header"](
            stamp=stamp, frame_id=frame, **({} if self.ros2 else {"seq": 0})
        )

    def vector(self, values: Iterable[float], kind: str = "Vector3") -> Any:
        return self.make[f"geometry_msgs/msg/{kind}"](*values)

    def pose(self, kind: str, stamp_ns: int, p: list[float], q: list[float], child: str = "base_link") -> Any:
        header, make = self.header(stamp_ns), self.make
        quaternion = make["geometry_msgs/msg/Quaternion"](*q)
        if kind == POSES[3]:
            turn = make["geometry_msgs/msg/Transform"](translation=self.vector(p), rotation=quaternion)
            return make[kind](header=header, child_frame_id=child, transform=turn)
        pose = make["geometry_msgs/msg/Pose"](position=self.vector(p, "Point"), orientation=quaternion)
        if kind == POSES[1]:
            return make[kind](header=header, pose=pose)
        sure = make["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=np.zeros(36))
        if kind == POSES[2]:
            return make[kind](header=header, pose=sure)
        zero = self.vector((0.0, 0.0, 0.0))
        still = make["geometry_msgs/msg/TwistWithCovariance"](
            twist=make["geometry_msgs/msg/Twist"](linear=zero, angular=zero), covariance=np.zeros(36)
        )
        return make[kind](header=header, child_frame_id=child, pose=sure, twist=still)

    def poses(self, kind: str, of: Trajectory, *, stamped: bool = True) -> list[Any]:
        stamps = of.stamp_ns.tolist() if stamped else [0] * len(of)
        rows = zip(stamps, of.position_m.tolist(), of.quat_xyzw.tolist(), strict=True)
        return [self.pose(kind, *row) for row in rows]

    def path(self, stamp_ns: int, poses: list[Any]) -> Any:
        return self.make[PATH](header=self.header(stamp_ns), poses=poses)

    def links(self, of: Trajectory, parent: str, child: str) -> list[tuple[int, Any]]:
        found = []
        for stamp, message in zip(of.stamp_ns.tolist(), self.poses(POSES[3], of), strict=True):
            message.header.frame_id, message.child_frame_id = parent, child
            found.append((stamp, self.make[TF](transforms=[message])))
        return found

    def write(self, path: Path, entries: Iterable[Entry]) -> Path:
        bag: Any = Bag2(path, version=9, storage_plugin=StoragePlugin.MCAP) if self.ros2 else Bag1(path)
        with bag:
            connections: dict[str, Any] = {}
            for topic, kind, at_ns, message in entries:
                if topic not in connections:
                    connections[topic] = bag.add_connection(topic, kind, typestore=self.store)
                pack = self.store.serialize_cdr if self.ros2 else self.store.serialize_ros1
                bag.write(connections[topic], at_ns, pack(message, kind))
        return path
