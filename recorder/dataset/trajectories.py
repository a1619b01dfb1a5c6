"""Trajectories of any kind of file: text, or messages with poses in bags.

Trajectories in a tree of frames, as ROS's `/tf` has them.
"""

import logging
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader

from carlaloc_env.core import transforms
from carlaloc_env.core.errors import EvaluationError, unknown_name
from recorder.bags import open_bag, refused_in_one_line
from recorder.dataset.readings import stamp_ns
from recorder.evaluation.trajectory import Trajectory, in_order
from recorder.evaluation.trajectory_files import read_text_trajectory

TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
"""Types of messages that hold transforms, in ROS 1's first years and since."""

Tree = dict[str, tuple[str, Trajectory]]
"""Parent of each frame, and its motion there; a single pose: it is fixed."""


def messages_of(reader: AnyReader, topic: str) -> Iterator[tuple[str, int, Any]]:
    """Messages of a topic that the bag has, each with its type and the time at which it was recorded [ns]."""
    for connection, at_ns, raw in reader.messages([c for c in reader.connections if c.topic == topic]):
        yield connection.msgtype, at_ns, reader.deserialize(raw, connection.msgtype)


def read_tree(path: Path, reader: AnyReader, topic: str, frames: str = "") -> Trajectory:
    """Motion of a frame in another, at the stamps of the link between them with the most poses.

    Args:
        path: The bag.
        reader: Opened.
        topic: Topic of the transforms; fixed ones are taken from its neighbour ``…_static``.
        frames: ``PARENT.CHILD``; empty: the frame with the longest path, in the root frame, with a warning.

    Raises:
        EvaluationError: there is no such frame, or the child is not below the parent.
    """
    tree = _tree(path, reader, topic)
    pairs = {f"{parent}.{child}": (parent, child) for child in tree for parent in _above(tree, child)}
    if not frames:
        moving = [child for child, (_, moves) in tree.items() if len(moves) > 1]
        if not moving:
            raise EvaluationError(f"{path}: no frame on {topic} moves; known: {', '.join(sorted(tree))}")
        child = max(moving, key=lambda frame: tree[frame][1].length_m)
        frames = f"{_above(tree, child)[-1]}.{child}"
        _LOG.warning(
            "%s: %s:%s is read; --topic takes another of %s",
            path,
            topic,
            frames,
            ", ".join(sorted(pairs)[:9]),
        )
    if frames not in pairs:
        raise EvaluationError(f"{path}: {unknown_name('pair of frames PARENT.CHILD', frames, pairs)}")
    parent, child = pairs[frames]
    links = []
    while child != parent:
        child, moves = tree[child]
        links.append(moves)
    return replace(_chained(path, links[::-1]), name=path.stem)


def _tree(path: Path, reader: AnyReader, topic: str) -> Tree:
    rows: dict[tuple[str, str], list[tuple[int, Any]]] = {}
    topics = {c.topic for c in reader.connections if c.msgcount}
    for name in sorted({f"{topic}_static", topic} & topics):
        for _, _, message in messages_of(reader, name):
            for each in message.transforms:
                stamp = each.header.stamp
                link = (each.child_frame_id.strip("/"), each.header.frame_id.strip("/"))
                if name != topic and link in rows:
                    rows[link].clear()
                rows.setdefault(link, []).append((stamp.sec * 10**9 + stamp.nanosec, each.transform))
    tree: Tree = {}
    for (child, parent), found in rows.items():
        if child in tree:
            raise EvaluationError(f"{path}: frame {child} has two parents, {tree[child][0]} and {parent}")
        table = np.array([
            (v.x, v.y, v.z, q.x, q.y, q.z, q.w) for v, q in ((t.translation, t.rotation) for _, t in found)
        ])  # fmt: skip
        tree[child] = parent, in_order(path, np.array([s for s, _ in found]), table[:, :3], table[:, 3:])
    return tree


def _above(tree: Tree, frame: str) -> list[str]:
    """The frames above another, its parent first.

    Raises:
        EvaluationError: they are a circle.
    """
    found: list[str] = []
    while frame in tree:
        frame = tree[frame][0]
        if frame in found:
            raise EvaluationError(f"frame {frame} lies below itself on /tf; record another bag")
        found.append(frame)
    return found


def _chained(path: Path, links: list[Trajectory]) -> Trajectory:
    """Motion through all links, the outermost first."""
    moving = [link for link in links if len(link) > 1] or links
    stamps = max(moving, key=len).stamp_ns
    first, last = max(link.stamp_ns[0] for link in moving), min(link.stamp_ns[-1] for link in moving)
    stamps = stamps[(stamps >= first) & (stamps <= last)]
    if not len(stamps):
        raise EvaluationError(f"{path}: its transforms have no time in common")
    whole = links[0].at(stamps)
    for link in links[1:]:
        step = link.at(stamps)
        whole = replace(
            whole,
            has_attitudes=whole.has_attitudes or step.has_attitudes,
            position_m=whole.position_m + transforms.quat_rotate(whole.quat_xyzw, step.position_m),
            quat_xyzw=transforms.quat_multiply(whole.quat_xyzw, step.quat_xyzw),
        )
    return whole


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
_LOG = logging.getLogger(__name__)

Row = tuple[int, float, float, float, float, float, float, float]
"""Time [ns], position [m], quaternion xyzw."""


def read_trajectory(
    path: str | Path,
    *,
    times: Path | None = None,
    topic: str | None = None,
    quaternion: str | None = None,
    time_unit: str | None = None,
) -> Trajectory:
    """Read a trajectory of any known kind.

    Args:
        path: A ROS 1 or ROS 2 bag, or a text file: see `read_text_trajectory`.
        times: Times of KITTI's poses, a line each; None: ``times.txt`` beside the file.
        topic: Topic of a bag, ``/tf:map.base_link`` for two frames of a tree; None: the only one with poses.
        quaternion: ``xyzw`` or ``wxyz``, where a text does not name its columns; None: by form and motion.
        time_unit: Unit of the times of a text: ``s``, ``ms``, ``us`` or ``ns``; None: by name or size.

    Raises:
        EvaluationError: the file is missing, damaged or of no such kind.
    """
    path = Path(path)
    if path.is_dir() or path.name.removesuffix(".zstd").endswith((".bag", ".mcap", ".db3")):
        return read_bag(path, topic)
    return read_text_trajectory(path, times=times, quaternion=quaternion, time_unit=time_unit)


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
    known = [t for group in groups for t in group]
    if topic is not None:
        if (name := topic.partition(":")[0]) not in known:
            raise EvaluationError(f"{path}: {unknown_name('topic with poses', name, known)}; {_read(types)}")
        return topic
    fitting = next((group for group in groups if group), [])
    if not fitting:
        raise EvaluationError(f"{path} has no topic with poses; {_read(types)}")
    if len(fitting) > 1:
        raise EvaluationError(f"{path} has several topics with poses; choose by --topic: {', '.join(known)}")
    if len(known) > 1:
        _LOG.warning(
            "%s: poses of %s are read; --topic takes another of %s", path, fitting[0], ", ".join(known)
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
