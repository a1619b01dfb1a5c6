"""Reads trajectories in a tree of frames, as ROS's `/tf` has them."""

import logging
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader

from carlaloc_env.core import transforms
from carlaloc_env.core.errors import EvaluationError, unknown_name
from recorder.dataset.bag_messages import stamp_ns
from recorder.evaluation.trajectory import Trajectory
from recorder.evaluation.trajectory_checks import in_order

_LOG = logging.getLogger(__name__)
TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
"""Types of messages that hold transforms, in ROS 1's first years and since."""
Tree = dict[str, tuple[str, Trajectory]]
"""Parent of each frame, and its motion there; a single pose is a static transform."""


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
                link = (each.child_frame_id.strip("/"), each.header.frame_id.strip("/"))
                if name != topic and link in rows:
                    rows[link].clear()
                rows.setdefault(link, []).append((stamp_ns(each), each.transform))
    tree: Tree = {}
    for (child, parent), stamped in rows.items():
        if child in tree:
            raise EvaluationError(f"{path}: frame {child} has two parents, {tree[child][0]} and {parent}")
        table = np.array([
            (v.x, v.y, v.z, q.x, q.y, q.z, q.w) for v, q in ((t.translation, t.rotation) for _, t in stamped)
        ])  # fmt: skip
        tree[child] = parent, in_order(path, np.array([s for s, _ in stamped]), table[:, :3], table[:, 3:])
    return tree


def _above(tree: Tree, frame: str) -> list[str]:
    """The frames above another, its parent first.

    Raises:
        EvaluationError: they are a circle.
    """
    ancestors: list[str] = []
    while frame in tree:
        frame = tree[frame][0]
        if frame in ancestors:
            raise EvaluationError(f"frame {frame} lies below itself on /tf; record another bag")
        ancestors.append(frame)
    return ancestors


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
