"""Feeds a bag to a ROS 1 node in lock-step and keeps the poses that it publishes.

Runs under the system's Python, which has Debian's ROS 1, and imports nothing of ours but the files beside it.
"""

from __future__ import annotations

import argparse
import os
import socket
import subprocess
import sys
import time
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

try:
    import rosbag
    import rosgraph
    import rospy
    from rosgraph_msgs.msg import Clock
except ImportError as missing:
    sys.exit(f"{sys.executable} has no {missing.name}; apt-get install ros-core python3-rosbag")

if TYPE_CHECKING:
    from recorder.slam.ros1.lock_step import LockStep, SilentError
    from recorder.slam.ros1.node import GoneError, Node
    from recorder.slam.ros1.point_labels import UnlabelledError, without_labels
else:
    # Beside this file: the system's Python does not know our packages.
    from lock_step import LockStep, SilentError
    from node import GoneError, Node
    from point_labels import UnlabelledError, without_labels

_START_LIMIT_S = 60.0
"""How long a node may take to subscribe [s]."""
_SETTLED_S = 1.0
"""How long topics must stay as they are: a node subscribes to one after the other [s]."""


def play(bag: Any, node: Node, arguments: argparse.Namespace) -> None:
    """Publish what the node reads of a bag, waiting for its poses after each message on the pace's topic.

    Raises:
        GoneError: the node has ended or subscribes to nothing.
        SilentError: it hangs.
        UnlabelledError: clouds have no labels by which to take points out.
    """
    topics = list(bag.get_type_and_topic_info().topics)
    if arguments.pace not in topics:
        raise GoneError(f"the bag has no {arguments.pace}; it has {', '.join(sorted(topics))}")
    renamed = dict(pair.split("=", 1) for pair in arguments.remap)
    read = _read_topics({topic: renamed.get(topic, topic) for topic in topics}, arguments.pace, node)
    publishers = {topic: _publisher(bag, topic, renamed.get(topic, topic)) for topic in read}
    clock = rospy.Publisher("/clock", Clock, queue_size=10)
    until = time.monotonic() + _START_LIMIT_S
    while not all(topic.get_num_connections() for topic in publishers.values()) and time.monotonic() < until:
        node.look(0.05)
    node.input = publishers[arguments.pace]
    steps = LockStep(node, patience_s=arguments.patience, silence_s=arguments.silence)
    for topic, message, at in bag.read_messages(topics=list(publishers)):
        clock.publish(at)
        if topic == arguments.pace and arguments.without:
            without_labels(message, arguments.without)
        publishers[topic].publish(message)
        if topic == arguments.pace:
            steps.sent(message.header.stamp.to_sec())
    steps.finish()


def _read_topics(names: dict[str, str], pace: str, node: Node) -> list[str]:
    """Topics of the bag, by their names there, that someone subscribes to, when they change no more."""
    master = rosgraph.Master(rospy.get_name())
    read: list[str] = []
    began_s = changed_s = time.monotonic()
    while pace not in read or time.monotonic() - changed_s < _SETTLED_S:
        subscribed = {topic for topic, _ in master.getSystemState()[1]}
        now = [topic for topic, name in names.items() if name in subscribed and topic != "/clock"]
        if now != read:
            read, changed_s = now, time.monotonic()
        if pace not in read and time.monotonic() - began_s > _START_LIMIT_S:
            raise GoneError(f"no node subscribes to {names[pace]}; name its topic by 'remap'")
        node.look(0.1)
    return read


def _publisher(bag: Any, topic: str, name: str) -> Any:
    """Publisher of a topic of the bag, by the definition of its messages there."""
    kind = type(next(bag.read_messages(topics=[topic]))[1])
    # Without a queue it sends before it returns; rospy warns of that.
    warnings.simplefilter("ignore", SyntaxWarning)
    return rospy.Publisher(name, kind, queue_size=None, latch="tf_static" in topic)


def main(words: Sequence[str] | None = None) -> None:
    """Start a master of its own, so that runs share the machine, and the node; play; write the poses.

    It ends when the node does. An error is the last line on stderr. `keeper.py`, under which it runs, ends
    the processes that it has started.
    """
    parser = argparse.ArgumentParser(
        description="Feed a bag to a ROS 1 node in lock-step, and keep the poses that it publishes."
    )
    parser.add_argument("bag")
    parser.add_argument("out_bag")
    parser.add_argument("poses", help="topic of the poses")
    parser.add_argument("pace", help="topic of the bag whose messages are waited for")
    parser.add_argument(
        "--remap", action="append", default=[], metavar="FROM=TO", help="name that the node has for a topic"
    )
    parser.add_argument(
        "--without",
        type=int,
        action="append",
        metavar="LABEL",
        help="label of points of the pace to leave out",
    )
    parser.add_argument("--patience", type=float, default=2.0, help="longest wait for a node at rest [s]")
    parser.add_argument("--silence", type=float, default=60.0, help="longest time without poses [s]")
    parser.add_argument("command", nargs="+")
    arguments = parser.parse_args(words)
    try:
        _start_master()
        rospy.init_node("carlaloc_player", disable_signals=True)
        node = Node(arguments.poses, arguments.command)
        with rosbag.Bag(arguments.bag) as bag:
            play(bag, node, arguments)
    except OSError as error:
        sys.exit(f"cannot start {error.filename}: {error.strerror}; install it")
    except (GoneError, SilentError, UnlabelledError) as error:
        sys.exit(str(error))
    if not node.messages:
        sys.exit(f"no message came on {arguments.poses}")
    with rosbag.Bag(arguments.out_bag, "w") as out:
        for message in node.messages:
            out.write(arguments.poses, message, message.header.stamp)


def _start_master() -> None:
    """A master on a free port, known to all that is started from here."""
    with socket.socket() as free:
        free.bind(("localhost", 0))
        port = free.getsockname()[1]
    os.environ |= {"ROS_MASTER_URI": f"http://localhost:{port}", "PYTHONUNBUFFERED": "1"}
    master = subprocess.Popen(["roscore", "-p", str(port)], stderr=subprocess.STDOUT)
    while not rosgraph.is_master_online():
        if master.poll() is not None:
            raise GoneError(f"roscore ended with {master.returncode}")
        time.sleep(0.1)
    rosgraph.Master("/carlaloc_player").setParam("/use_sim_time", True)


if __name__ == "__main__":
    main()
