"""Reads trajectories of any kind of file: text, or messages with poses in bags."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError, unknown_name
from recorder.bags.reader import open_bag, refused_in_one_line
from recorder.dataset.bag_messages import stamp_ns
from recorder.dataset.transform_tree import TF_TYPES, messages_of, read_tree
from recorder.evaluation.pcd_poses import is_pcd, read_pcd_poses
from recorder.evaluation.rtklib_pos import SUFFIX, read_pos
from recorder.evaluation.trajectory import Trajectory
from recorder.evaluation.trajectory_checks import in_order
from recorder.evaluation.trajectory_files import read_text_trajectory

_LOG = logging.getLogger(__name__)
_POSE_OF: dict[str, Callable[[Any], tuple[Any, Any]]] = {
    "nav_msgs/msg/Odometry": lambda m: (m.pose.pose.position, m.pose.pose.orientation),
    "geometry_msgs/msg/PoseStamped": lambda m: (m.pose.position, m.pose.orientation),
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda m: (m.pose.pose.position, m.pose.pose.orientation),
    "geometry_msgs/msg/TransformStamped": lambda m: (m.transform.translation, m.transform.rotation),
}
"""Position and attitude of a message, by its type; evo reads the same types."""
_PATH = "nav_msgs/msg/Path"
_KINDS = (tuple(_POSE_OF), (_PATH,), TF_TYPES)
"""Types that are read; earlier groups take precedence."""
Row = tuple[int, float, float, float, float, float, float, float]
"""Time [ns], position [m], quaternion xyzw."""


def read_trajectory(
    path: str | Path,
    *,
    times: Path | None = None,
    topic: str | None = None,
    quaternion: str | None = None,
    time_unit: str | None = None,
    origin: Array | None = None,
) -> Trajectory:
    """Read a trajectory of any known kind.

    Args:
        path: A ROS 1 or ROS 2 bag, LIO-SAM's ``transformations.pcd``, RTKLIB's ``.pos``, or a text: see
            `read_text_trajectory`.
        times: Times of KITTI's poses, a line each; None: ``times.txt`` beside the file.
        topic: Topic of a bag, ``/tf:map.base_link`` for two frames of a tree; None: the only one with poses.
        quaternion: ``xyzw`` or ``wxyz``, where a text does not name its columns; None: by form and motion.
        time_unit: Unit of the times of a text: ``s``, ``ms``, ``us`` or ``ns``; None: by name or size.
        origin: Origin of RTKLIB's solutions: latitude, longitude [deg], height [m]; None: their first.

    Raises:
        EvaluationError: the file is missing, damaged or of no such kind.
    """
    path = Path(path)
    if path.suffix == SUFFIX:
        return read_pos(path, origin)
    if is_pcd(path):
        return read_pcd_poses(path)
    if path.is_dir() or path.name.removesuffix(".zstd").endswith((".bag", ".mcap", ".db3")):
        return read_bag(path, topic)
    return read_text_trajectory(path, times=times, quaternion=quaternion, time_unit=time_unit)


def named_apart(paths: Sequence[Path], trajectories: Sequence[Trajectory]) -> list[Trajectory]:
    """Trajectories named by their files, with as much of the paths as tells files of one name apart."""
    places = [Path.cwd() / path for path in paths]
    names = [place.stem for place in places]
    for depth in range(1, max((len(place.parts) for place in places), default=0)):
        for whole in (False, True):
            alike = {name for name in names if names.count(name) > 1}
            names = [
                "/".join((*place.parts[-depth:-1], place.name if whole else place.stem))
                if name in alike
                else name
                for place, name in zip(places, names, strict=True)
            ]
    return [replace(one, name=name) for one, name in zip(trajectories, names, strict=True)]


def read_bag(path: Path, topic: str | None = None) -> Trajectory:
    """Poses of one topic of a ROS 1 or ROS 2 bag, at the times in their headers.

    Of a `nav_msgs/Path` the last message counts, if it reaches back to the beginning of the first; else the
    poses of all messages, where later messages take precedence.

    Args:
        path: A ``.bag``, ``.mcap`` or ``.db3`` file, or the folder of a ROS 2 bag.
        topic: The topic, ``/tf:map.base_link`` for two frames of a tree; None: the only topic with poses.

    Raises:
        EvaluationError: the bag is missing or damaged, or has no such topic.
    """
    with refused_in_one_line(path), open_bag(path) as reader:
        name, _, frames = _chosen(path, reader, topic).partition(":")
        kind = next(c.msgtype for c in reader.connections if c.topic == name)
        if kind in TF_TYPES:
            return read_tree(path, reader, name, frames)
        rows = _path_rows(path, reader, name) if kind == _PATH else _pose_rows(path, reader, name)
    if not rows:
        raise EvaluationError(f"{path} holds no pose on {name}")
    table = np.array([row[1:] for row in rows])
    return in_order(path, np.array([row[0] for row in rows], dtype=np.int64), table[:, :3], table[:, 3:])


def _chosen(path: Path, reader: AnyReader, topic: str | None) -> str:
    types = {c.topic: c.msgtype for c in reader.connections if c.msgcount}
    groups = [
        sorted(t for t, kind in types.items() if kind in kinds and not t.endswith("tf_static"))
        for kinds in _KINDS
    ]
    topics = [t for group in groups for t in group]
    if topic is not None:
        if (name := topic.partition(":")[0]) not in topics:
            raise EvaluationError(f"{path}: {unknown_name('topic with poses', name, topics)}; {_read(types)}")
        return topic
    fitting = next((group for group in groups if group), [])
    if not fitting:
        raise EvaluationError(f"{path} has no topic with poses; {_read(types)}")
    if len(fitting) > 1:
        raise EvaluationError(f"{path} has several topics with poses; choose by --topic: {', '.join(topics)}")
    if len(topics) > 1:
        _LOG.warning(
            "%s: poses of %s are read; --topic takes another of %s", path, fitting[0], ", ".join(topics)
        )
    return fitting[0]


def _read(types: dict[str, str]) -> str:
    """Types that are read, and types of a bag."""
    read = ", ".join(
        kind.replace("/msg/", "/") for kinds in _KINDS for kind in kinds[:4] if kind != TF_TYPES[1]
    )
    has = ", ".join(sorted({kind.replace("/msg/", "/") for kind in types.values()})) or "no messages"
    return f"read are {read}; the bag has {has}"


def _pose_rows(path: Path, reader: AnyReader, topic: str) -> list[Row]:
    rows: list[Row] = []
    recorded_ns: list[int] = []
    frames: set[tuple[str, str]] = set()
    for kind, at_ns, message in messages_of(reader, topic):
        recorded_ns.append(at_ns)
        rows.append((stamp_ns(message), *_numbers(*_POSE_OF[kind](message))))
        frames.add((message.header.frame_id, getattr(message, "child_frame_id", "")))
    if len(frames) > 1:
        pairs = ", ".join(sorted(" to ".join(filter(None, pair)) for pair in frames))
        _LOG.warning(
            "%s: %s holds poses of several frames (%s), read as a single frame's", path, topic, pairs
        )
    if len(rows) > 1 and len({row[0] for row in rows}) == 1:
        _LOG.warning("%s: messages on %s have no stamps; the times of their recording are taken", path, topic)
        rows = [(at_ns, *row[1:]) for at_ns, row in zip(recorded_ns, rows, strict=True)]
    return rows


def _path_rows(path: Path, reader: AnyReader, topic: str) -> list[Row]:
    first = last = None
    for _, _, last in messages_of(reader, topic):
        first = first or last
    if first is None or last is None or not last.poses:
        return []
    rows = _rows_of(last)
    if len(rows) > 1 and len({row[0] for row in rows}) == 1:
        _LOG.warning(
            "%s: poses on %s have no stamps; of each message the last pose is taken, at its header's",
            path,
            topic,
        )
        return [
            (stamp_ns(message), *_rows_of(message)[-1][1:])
            for _, _, message in messages_of(reader, topic)
            if message.poses
        ]
    if first.poses and rows[0][0] > stamp_ns(first.poses[0]):
        _LOG.warning("%s: paths on %s forget their beginning; the poses of all are joined", path, topic)
        joined = {row[0]: row for _, _, message in messages_of(reader, topic) for row in _rows_of(message)}
        return [joined[at_ns] for at_ns in sorted(joined)]
    return rows


def _rows_of(path_message: Any) -> list[Row]:
    return [(stamp_ns(p), *_numbers(p.pose.position, p.pose.orientation)) for p in path_message.poses]


def _numbers(p: Any, q: Any) -> tuple[float, float, float, float, float, float, float]:
    return p.x, p.y, p.z, q.x, q.y, q.z, q.w
