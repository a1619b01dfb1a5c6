"""Feeds a bag to a ROS 1 node in lock-step and keeps the poses that it publishes.

play.py BAG OUT_BAG POSES PACE [--remap FROM=TO …] [--without LABEL …] [--patience S] [--silence S]
        -- COMMAND…

Starts a master of its own, so that several runs share the machine, and the command (roslaunch, or a node),
publishes the topics of the bag that it reads, and after each message on PACE waits for poses by the rule of
`feeding.py`. It ends when the node does, with the last line that the node printed. What it has started
it leaves to `keeper.py`, under which it runs.

Runs under the system's Python, which has Debian's ROS 1, and imports nothing of ours but what lies beside it.
Classes of messages are made from the definitions that bags and publishers bring.
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
    from recorder.slam.ros1.feeding import LockStep, SilentError, UnlabelledError, without_labels
    from recorder.slam.ros1.node import GoneError, Node
else:
    # Beside this file: the system's Python does not know our packages.
    from feeding import LockStep, SilentError, UnlabelledError, without_labels
    from node import GoneError, Node

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
    found: list[str] = []
    began_s = changed_s = time.monotonic()
    while pace not in found or time.monotonic() - changed_s < _SETTLED_S:
        subscribed = {topic for topic, _ in master.getSystemState()[1]}
        now = [topic for topic, name in names.items() if name in subscribed and topic != "/clock"]
        if now != found:
            found, changed_s = now, time.monotonic()
        if pace not in found and time.monotonic() - began_s > _START_LIMIT_S:
            raise GoneError(f"no node subscribes to {names[pace]}; name its topic by 'remap'")
        node.look(0.1)
    return found


def _publisher(bag: Any, topic: str, name: str) -> Any:
    """Publisher of a topic of the bag, by the definition of its messages there."""
    kind = type(next(bag.read_messages(topics=[topic]))[1])
    # Without a queue it sends before it returns; rospy warns of that.
    warnings.simplefilter("ignore", SyntaxWarning)
    return rospy.Publisher(name, kind, queue_size=None, latch="tf_static" in topic)


def main(words: Sequence[str] | None = None) -> None:
    """Start master and node, play, and write the poses; what went wrong is the last line on stderr."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
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
