"""Trajectories in bags: messages that hold a pose."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from carlaloc_env.core.errors import EvaluationError, unknown_name
from recorder.evaluation.trajectory import Trajectory, in_order

_POSE_OF: dict[str, Callable[[Any], tuple[Any, Any]]] = {
    "nav_msgs/msg/Odometry": lambda m: (m.pose.pose.position, m.pose.pose.orientation),
    "geometry_msgs/msg/PoseStamped": lambda m: (m.pose.position, m.pose.orientation),
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda m: (m.pose.pose.position, m.pose.pose.orientation),
    "geometry_msgs/msg/TransformStamped": lambda m: (m.transform.translation, m.transform.rotation),
}
"""Position and attitude of a message, by its type; evo reads the same types."""


def read_bag(path: Path, topic: str | None = None) -> Trajectory:
    """Poses of one topic of a ROS 1 or ROS 2 bag, at the times in their headers.

    Args:
        path: A ``.bag`` file, or the folder of a ROS 2 bag or a file in it.
        topic: The topic; None: the only one that holds poses.

    Raises:
        EvaluationError: the bag is missing or damaged, or has no such topic.
    """
    folder = path.parent if path.suffix in (".mcap", ".db3") else path
    rows: list[tuple[int, Any, Any]] = []
    try:
        with AnyReader([folder], default_typestore=get_typestore(Stores.ROS1_NOETIC)) as reader:
            fitting = [c for c in reader.connections if c.msgtype in _POSE_OF and c.msgcount]
            wanted = _chosen(path, sorted({c.topic for c in fitting}), topic)
            for connection, _, raw in reader.messages([c for c in fitting if c.topic == wanted]):
                message: Any = reader.deserialize(raw, connection.msgtype)
                stamp = message.header.stamp
                at_ns = stamp.sec * 1_000_000_000 + stamp.nanosec
                rows.append((at_ns, *_POSE_OF[connection.msgtype](message)))
    except EvaluationError:
        raise
    # A damaged bag makes the library raise whatever its parts do: struct, zlib, assertions, …
    except Exception as error:
        raise EvaluationError(
            f"cannot read {path}: no ROS bag, or a damaged one; give a whole bag"
        ) from error
    table = np.array([(p.x, p.y, p.z, q.x, q.y, q.z, q.w) for _, p, q in rows])
    return in_order(path, np.array([at_ns for at_ns, _, _ in rows]), table[:, :3], table[:, 3:])


def _chosen(path: Path, topics: list[str], topic: str | None) -> str:
    if topic is not None and topic not in topics:
        raise EvaluationError(f"{path}: {unknown_name('topic with poses', topic, topics)}")
    if not topics:
        raise EvaluationError(f"{path} has no topic with poses; give a bag with odometry or poses")
    if topic is None and len(topics) > 1:
        raise EvaluationError(f"{path} has several topics with poses; choose by --topic: {', '.join(topics)}")
    return topic or topics[0]
