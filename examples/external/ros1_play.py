#!/usr/bin/python3
"""Feeds a bag to a ROS 1 node in lock-step and keeps the poses that it publishes.

ros1_play.py BAG OUT_BAG POSES --pace TOPIC [--remap FROM=TO …] [--wait S] -- COMMAND…

Starts a master of its own and the command (rosrun or roslaunch), publishes the bag, and after each message on
the topic of --pace waits for poses up to its stamp, so that a busy machine drops nothing. Of a node that
answers later, or to every second message only, it learns how far it lags: once there are poses, a wait in
vain (--wait at most) is not repeated for the same lag. Runs under the system's Python, which has Debian's
ROS 1 (apt-get install ros-core python3-rosbag).
"""

from __future__ import annotations

import argparse
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from typing import Any

import rosbag
import rosgraph
import rospy

_START_LIMIT_S = 60.0
"""How long a node may take to subscribe [s]."""


class Poses:
    """Poses that arrive on a topic, as they came, and the stamp of the latest."""

    def __init__(self, topic: str) -> None:
        self._arrived = threading.Condition()
        self.messages: list[tuple[float, Any]] = []
        """Stamps [s] and messages."""
        rospy.Subscriber(topic, rospy.AnyMsg, self._take, queue_size=None)

    def _take(self, raw: Any) -> None:
        kind = rosbag_class(raw._connection_header["type"])
        message = kind().deserialize(raw._buff)
        with self._arrived:
            self.messages.append((message.header.stamp.to_sec(), message))
            self._arrived.notify()

    def wait(self, stamp_s: float, limit_s: float) -> bool:
        """Whether a pose of that stamp or later came within the limit."""
        with self._arrived:
            return self._arrived.wait_for(
                lambda: bool(self.messages) and self.messages[-1][0] >= stamp_s - 1e-4, limit_s
            )


def rosbag_class(name: str) -> Any:
    """Class of a message by its name, as ``nav_msgs/Odometry``."""
    import roslib.message

    found = roslib.message.get_message_class(name)
    if found is None:
        sys.exit(f"ros1_play: no Python messages for {name}; install its Debian package python3-…-msgs")
    return found


def play(bag: Any, poses: Poses, arguments: argparse.Namespace) -> None:
    """Publish a bag, waiting for poses after each message on the topic of --pace."""
    renamed = dict(pair.split("=", 1) for pair in arguments.remap)
    info = bag.get_type_and_topic_info().topics
    if arguments.pace not in info:
        sys.exit(f"ros1_play: the bag has no {arguments.pace}; it has {', '.join(sorted(info))}")
    publishers = {
        topic: rospy.Publisher(
            renamed.get(topic, topic),
            rosbag_class(entry.msg_type),
            queue_size=None,
            latch="tf_static" in topic,
        )
        for topic, entry in info.items()
        if topic != "/clock" and topic.split("/")[1] != "ground_truth"
    }
    clock = rospy.Publisher("/clock", rosbag_class("rosgraph_msgs/Clock"), queue_size=10)
    until = time.monotonic() + _START_LIMIT_S
    while publishers[arguments.pace].get_num_connections() == 0:
        if time.monotonic() > until:
            name = renamed.get(arguments.pace, arguments.pace)
            sys.exit(f"ros1_play: nobody subscribes to {name}; give --remap as the node names its topics")
        time.sleep(0.05)
    time.sleep(1.0)
    sent: list[float] = []
    lag = 0
    for topic, message, at in bag.read_messages(topics=list(publishers)):
        clock.publish(at)
        publishers[topic].publish(message)
        if topic != arguments.pace:
            continue
        sent.append(message.header.stamp.to_sec())
        if len(sent) <= lag or poses.wait(sent[-1 - lag], arguments.wait):
            continue
        # A node that has not begun yet says nothing of how far it will lag.
        lag += bool(poses.messages)
    poses.wait(sent[-1], 5.0)


def main(words: Sequence[str] | None = None) -> None:
    """Start master and node, play, and write the poses."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("bag")
    parser.add_argument("out_bag")
    parser.add_argument("poses", help="topic of the poses")
    parser.add_argument("--pace", required=True, help="topic of the bag whose messages are waited for")
    parser.add_argument(
        "--remap", nargs="*", default=[], metavar="FROM=TO", help="topics that the node names otherwise"
    )
    parser.add_argument("--wait", type=float, default=2.0, help="longest wait for a pose [s]")
    parser.add_argument("command", nargs="+")
    arguments = parser.parse_args(words)
    # A master of its own lets several runs share the machine.
    with socket.socket() as free:
        free.bind(("localhost", 0))
        port = free.getsockname()[1]
    os.environ["ROS_MASTER_URI"] = f"http://localhost:{port}"
    started = [subprocess.Popen(["roscore", "-p", str(port)], start_new_session=True)]
    try:
        while not rosgraph.is_master_online():
            time.sleep(0.1)
        subprocess.run(["rosparam", "set", "use_sim_time", "true"], check=True)
        started.append(subprocess.Popen(arguments.command, start_new_session=True))
        rospy.init_node("ros1_play", disable_signals=True)
        poses = Poses(arguments.poses)
        with rosbag.Bag(arguments.bag) as bag:
            play(bag, poses, arguments)
    except OSError as error:
        sys.exit(f"ros1_play: {error}")
    finally:
        end(started)
    if not poses.messages:
        sys.exit(f"ros1_play: no message came on {arguments.poses}; see the node's words above")
    with rosbag.Bag(arguments.out_bag, "w") as out:
        for _, message in poses.messages:
            out.write(arguments.poses, message, message.header.stamp)


def end(started: Sequence[subprocess.Popen[bytes]]) -> None:
    """End what was started, the last first, and wait for it."""
    for process in reversed(started):
        for with_signal in (signal.SIGINT, signal.SIGKILL):
            try:
                os.killpg(process.pid, with_signal)
                process.wait(15)
                break
            except ProcessLookupError:
                break
            except subprocess.TimeoutExpired:
                continue


if __name__ == "__main__":
    main()
