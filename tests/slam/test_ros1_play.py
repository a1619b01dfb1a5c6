"""Lock-step of the player for ROS 1 nodes: a slow node that forgets what it has no time for still sees all.

The node is a real one, on a real master; it knows the truth and gives it as its pose.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from shared_fixtures.processes.external_programs import EXTERNAL, SYSTEM_PYTHON, missing_ros
from shared_fixtures.readings.slam_dataset import write_dataset

from recorder.benchmark.run import BenchmarkConfig, run_benchmark

SWEEPS = 12
NODE = """
import sys, time
import rospy
from nav_msgs.msg import Odometry
from sensor_msgs.msg import PointCloud2

rospy.init_node("slow")
rows = [[float(word) for word in line.split()] for line in open(sys.argv[1]) if not line.startswith("#")]
out = rospy.Publisher("/odom", Odometry, queue_size=10)
seen = 0

def take(cloud):
    global seen
    time.sleep(0.2)
    seen += 1
    if seen % EVERY:
        return
    stamp = cloud.header.stamp.to_sec()
    row = min(rows, key=lambda row: abs(row[0] - stamp))
    pose = Odometry()
    pose.header.stamp = cloud.header.stamp
    place, turn = pose.pose.pose.position, pose.pose.pose.orientation
    place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w = row[1:8]
    out.publish(pose)

rospy.Subscriber("/velodyne_points", PointCloud2, take, queue_size=1)
rospy.spin()
"""


@pytest.fixture(scope="module", autouse=True)
def _ros() -> None:
    if missing := missing_ros():
        pytest.skip(missing)


def played(tmp_path: Path, node: str, *options: str) -> tuple[str | None, float, float]:
    """Why it failed, share of the sweeps that have a pose, and error [m]."""
    data = write_dataset(tmp_path / "set", sweeps=SWEEPS)
    (tmp_path / "node.py").write_text(node)
    words = [
        str(EXTERNAL / "ros1_play.py"), "{bag}", "{out_bag}", "/odom", "--pace", "/lidar/points", *options,
        "--", SYSTEM_PYTHON, str(tmp_path / "node.py"), "{calibration}/../ground_truth/lidar.tum",
    ]  # fmt: skip
    (tmp_path / "slow.yaml").write_text(
        "{name: slow, title: Slow, needs: [lidar], frame: lidar, instant: start, topic: /odom, "
        f"command: {words}}}"
    )
    (data / "Box" / "calibration").mkdir()
    config = BenchmarkConfig(
        data=data, out=tmp_path / "out", methods=(str(tmp_path / "slow.yaml"),), clouds=("raw",)
    )
    (score,) = run_benchmark(config).scores
    return score.failed, score.coverage, score.ape_m


RENAMED = ("--remap", "/lidar/points=/velodyne_points")


def test_a_slow_node_sees_every_sweep(tmp_path: Path) -> None:
    failed, coverage, ape_m = played(tmp_path, NODE.replace("EVERY", "1"), *RENAMED)
    assert failed is None
    assert coverage == 1.0
    assert ape_m < 1e-3


def test_a_node_that_answers_every_second_sweep_is_not_waited_for_each_time(tmp_path: Path) -> None:
    failed, coverage, _ = played(tmp_path, NODE.replace("EVERY", "2"), *RENAMED, "--wait", "1")
    assert coverage == pytest.approx(0.5, abs=0.1)
    assert failed is not None
    assert "cover" in failed


def test_a_node_that_says_nothing_is_named(tmp_path: Path) -> None:
    failed, _, _ = played(tmp_path, NODE.replace("EVERY", "1000"), *RENAMED, "--wait", "0.3")
    log = next((tmp_path / "out").rglob("log.txt")).read_text()
    assert "no message came on /odom" in log
    assert failed is not None
    assert "ended with 1" in failed
