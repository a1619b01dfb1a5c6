"""ROS 1's own command line tools on our bags: info, check and play, from Debian's packages."""

import os
import re
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from shared_fixtures.readings.bag_samples import drive, read, rig, write_all

from recorder.writers.ros.rosbag1 import Ros1Encoder, Rosbag1Writer

_COUNT = """
import collections, sys, rospy
counts = collections.Counter()
rospy.init_node("listener", anonymous=True, disable_signals=True)
rospy.Subscriber("/lidar/points", rospy.AnyMsg, lambda message: counts.update(["points"]))
rospy.Subscriber("/imu/data", rospy.AnyMsg, lambda message: counts.update(["imu"]))
print("listening", flush=True)
sys.stdin.readline()
while sum(counts.values()) < int(sys.argv[1]) and not rospy.is_shutdown():
    rospy.sleep(0.05)
rospy.sleep(0.5)
print(counts["points"], counts["imu"])
"""
"""A node of ROS that counts what it is sent, until a line has come and as much as it is told to expect."""


@pytest.fixture(scope="module", params=["none", "lz4", "bz2"])
def bag(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    encoder = Ros1Encoder(rig(), streams={sample.sensor for sample in drive()})
    path = tmp_path_factory.mktemp("bags") / "a.bag"
    return write_all(Rosbag1Writer(path, encoder, compression=request.param), drive())


@pytest.fixture(scope="module")
def ros_master() -> Iterator[dict[str, str]]:
    """Environment of a running `roscore` on a free port."""
    if shutil.which("roscore") is None:
        pytest.skip("needs Debian's ros-core")
    core, env = started_master()
    while subprocess.run(["rosnode", "list"], env=env, capture_output=True, check=False).returncode:
        time.sleep(0.1)
        if core.poll() is not None:  # another program has taken the port meanwhile
            core, env = started_master()
    yield env
    core.terminate()
    core.wait()


def started_master() -> tuple[subprocess.Popen[bytes], dict[str, str]]:
    """A `roscore` on a port that was free a moment ago, and the environment to reach it."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    env = {**os.environ, "ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_IP": "127.0.0.1"}
    words = ["roscore", "-p", str(port)]
    return subprocess.Popen(words, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL), env


def ask_rosbag(*arguments: str, env: dict[str, str] | None = None) -> str:
    """What `rosbag` prints."""
    if shutil.which("rosbag") is None:
        pytest.skip("needs Debian's python3-rosbag")
    done = subprocess.run(
        ["rosbag", *arguments], capture_output=True, text=True, timeout=600, env=env, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_info_tells_what_is_in_it(bag: Path) -> None:
    told: dict[str, Any] = yaml.safe_load(ask_rosbag("info", "--yaml", str(bag)))
    _, messages = read(bag)
    assert {topic["topic"]: topic["messages"] for topic in told["topics"]} == {
        topic: len(entries) for topic, entries in messages.items()
    }
    assert told["indexed"]
    first, last = (pick(t for entries in messages.values() for t, _ in entries) for pick in (min, max))
    assert told["start"] == pytest.approx(first / 1e9, abs=1e-5)
    assert told["end"] == pytest.approx(last / 1e9, abs=1e-5)


def test_check_finds_no_message_that_changes(bag: Path) -> None:
    """Ours lack the comments of official definitions: a rule is named for each type, with the same sum."""
    needed = "import sensor_msgs.msg, nav_msgs.msg, tf2_msgs.msg, rosgraph_msgs.msg"
    if subprocess.run(["/usr/bin/python3", "-c", needed], capture_output=True, check=False).returncode:
        pytest.skip("needs Debian's packages of ROS 1 messages")
    told = ask_rosbag("check", str(bag))
    assert "All rules defined" in told
    rules = re.findall(r"From: (\S+ \[\w+\])\s+To: +(\S+ \[\w+\])", told)
    assert len(rules) >= 8
    assert all(before == after for before, after in rules)


def test_play_sends_every_message(bag: Path, ros_master: dict[str, str]) -> None:
    """A node that listens gets as many clouds and IMU readings as the bag holds."""
    _, messages = read(bag)
    sent = [len(messages[topic]) for topic in ("/lidar/points", "/imu/data")]
    words = ["/usr/bin/python3", "-c", _COUNT, str(sum(sent))]
    pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    listener = subprocess.Popen(words, env=ros_master, **pipes)
    assert listener.stdout is not None
    assert listener.stdout.readline() == "listening\n"
    ask_rosbag("play", "--quiet", "--wait-for-subscribers", "--topics", "/lidar/points", "/imu/data",
               "--bags", str(bag), env=ros_master)  # fmt: skip
    assert listener.communicate("\n", timeout=600)[0].split() == [str(count) for count in sent]
