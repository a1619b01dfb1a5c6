"""The player for ROS 1 nodes: slow, stalling, dying, hanging and hiding ones, on a real master.

The nodes know the truth and give it as their pose.
"""

import os
from pathlib import Path

import pytest
from shared_fixtures.processes.external_programs import SYSTEM_PYTHON, missing_ros
from shared_fixtures.readings.slam_dataset import SWEEP_NS, sweep, write_dataset

from carlaloc_env.scene.semantic_tags import Tag
from recorder.benchmark.run import BenchmarkConfig, run_benchmark
from recorder.benchmark.score import Score

SWEEPS = 8
NODE = """
import os, signal, subprocess, sys, time
import rospy
from nav_msgs.msg import Odometry
from sensor_msgs.msg import PointCloud2

rospy.init_node("slow", disable_signals=True)
rows = [[float(word) for word in line.split()] for line in open(sys.argv[1]) if not line.startswith("#")]
out = rospy.Publisher("/odom", Odometry, queue_size=10)
seen = 0

def answer(cloud):
    stamp = cloud.header.stamp.to_sec()
    row = min(rows, key=lambda row: abs(row[0] - stamp))
    pose = Odometry()
    pose.header.stamp = cloud.header.stamp
    place, turn = pose.pose.pose.position, pose.pose.pose.orientation
    place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w = row[1:8]
    out.publish(pose)

def take(cloud):
    global seen
    seen += 1
    DOES

rospy.Subscriber("/velodyne_points", PointCloud2, take, queue_size=1)
rospy.spin()
"""
SLOW = """import rosgraph
    told = [topic for topic, _ in rosgraph.Master("/slow").getSystemState()[0]]
    open(sys.argv[2], "w").write(" ".join(told))
    time.sleep(0.2)
    answer(cloud)"""
COMPUTING = """until = time.process_time() + (3.0 if seen == 6 else 0.05)
    while time.process_time() < until: pass
    answer(cloud)"""
HIDING = """answer(cloud)
    if seen == 3:
        words = ["import os, signal, sys, time; os.setsid(); signal.signal(signal.SIGINT, signal.SIG_DFL)",
                 "open(sys.argv[1], 'w').write(str(os.getpid()))",
                 "while time.process_time() < 1.5: pass",
                 "time.sleep(600)"]
        code = chr(10).join(words)
        subprocess.Popen(["sh", "-c", '"$@" & exit', "sh", sys.executable, "-c", code, sys.argv[2]])"""
READING_LABELS = """answer(cloud)
    at = [field.offset for field in cloud.fields if field.name == "label"][0]
    labels = sorted(set(cloud.data[at::cloud.point_step]))
    count = len(cloud.data) // cloud.point_step
    open(sys.argv[2], "a").write(f"{cloud.width} {count} {labels}" + chr(10))"""
LAUNCH = """
<launch>
    <node pkg="rosout" type="rosout" name="another"
        launch-prefix="sh -c 'trap true INT; while :; do sleep 1; done'" />
    <node pkg="rosout" type="rosout" name="slow" required="true" output="screen"
        launch-prefix="PYTHON NODE TRUTH" />
</launch>
"""


@pytest.fixture(scope="module", autouse=True)
def _ros() -> None:
    if missing := missing_ros():
        pytest.skip(missing)


@pytest.fixture
def data(tmp_path: Path) -> Path:
    root = write_dataset(tmp_path / "set", sweeps=SWEEPS)
    (root / "Box" / "calibration").mkdir()
    return root


def played(data: Path, does: str, *, command: str = "", options: str = "", cloud: str = "raw") -> Score:
    """Score of a node that does so with each sweep."""
    folder = data.parent
    (folder / "node.py").write_text(NODE.replace("DOES", does))
    truth = "{calibration}/../ground_truth/lidar.tum"
    words = f'[{SYSTEM_PYTHON}, "{{here}}/node.py", "{truth}", "{{here}}/pid"]'
    (folder / "slow.yaml").write_text(
        "{name: slow, title: Slow, needs: [lidar], frame: lidar, ros1: {poses: /odom, pace: /lidar/points, "
        f"remap: {{/lidar/points: /velodyne_points}}, {options} command: {command or words}}}}}"
    )
    config = BenchmarkConfig(
        data=data, out=folder / "out", methods=(str(folder / "slow.yaml"),), clouds=(cloud,)
    )
    (score,) = run_benchmark(config).scores
    return score


def test_a_slow_node_that_forgets_what_it_has_no_time_for_sees_every_sweep(data: Path) -> None:
    """And no topic but this one: the bag has clouds with labels too, of which the master hears nothing."""
    score = played(data, SLOW)
    assert (score.failed, score.coverage) == (None, 1.0)
    assert score.ape_m < 1e-3
    told = (data.parent / "pid").read_text().split()
    assert "/velodyne_points" in told
    assert not [topic for topic in told if topic.startswith("/lidar")]


def test_a_node_that_computes_long_for_one_sweep_drops_none(data: Path) -> None:
    """Longer than it is waited for at rest; and the processor time of all is in the record."""
    score = played(data, COMPUTING, options="patience_s: 0.3,")
    assert (score.failed, score.coverage) == (None, 1.0)
    assert score.cpu_s > 3.5


def test_seg_clouds_come_without_the_points_on_movers(data: Path) -> None:
    score = played(data, READING_LABELS, cloud="seg")
    assert (score.failed, score.coverage, score.cloud) == (None, 1.0, "seg")
    told = [line.split(maxsplit=2) for line in (data.parent / "pid").read_text().splitlines()]
    houses = [int((sweep(k * SWEEP_NS).tag == Tag.BUILDING).sum()) for k in range(SWEEPS)]
    assert told == [[str(count), str(count), f"[{int(Tag.BUILDING)}]"] for count in houses]


def test_a_node_that_answers_every_second_sweep_sees_all(data: Path) -> None:
    score = played(data, "answer(cloud) if seen % 2 else None", options="patience_s: 0.5, every: 2,")
    assert (score.failed, score.coverage) == (None, 1.0)


def test_a_node_that_says_nothing_is_named(data: Path) -> None:
    score = played(data, "pass", options="patience_s: 0.5,")
    assert str(score.failed).startswith("no message came on /odom; log: ")
    assert Path(str(score.failed).partition("log: ")[2]).is_file()


def test_a_node_that_dies_ends_the_run_with_its_last_line(data: Path) -> None:
    score = played(data, "answer(cloud) if seen < 4 else (print('no more memory', flush=True), os._exit(3))")
    assert "python3 ended with 3: no more memory; log: " in str(score.failed)


def test_a_required_node_of_a_launch_file_ends_the_run_though_others_will_not_end(data: Path) -> None:
    launch = LAUNCH.replace("PYTHON", SYSTEM_PYTHON).replace("NODE", str(data.parent / "node.py"))
    launch = launch.replace("TRUTH", str(data / "Box" / "ground_truth" / "lidar.tum"))
    (data.parent / "nodes.launch").write_text(launch)
    does = "answer(cloud) if seen < 4 else (print('no more memory', flush=True), os._exit(3))"
    score = played(data, does, command='[roslaunch, "{here}/nodes.launch"]')
    assert "REQUIRED process [slow" in str(score.failed)
    assert "no more memory; log: " in str(score.failed)


def test_a_node_that_is_not_built_is_named(data: Path) -> None:
    (data.parent / "nodes.launch").write_text('<launch><node pkg="rosout" type="no" name="a" /></launch>')
    score = played(data, "pass", command='[roslaunch, "{here}/nodes.launch"]')
    assert "ERROR: cannot launch node of type [rosout/no]" in str(score.failed)


def test_a_node_that_hangs_is_ended(data: Path) -> None:
    score = played(data, "answer(cloud) if seen < 4 else time.sleep(600)", options="silence_s: 2,")
    assert str(score.failed).startswith("no pose for 2 s; log: ")


def test_nothing_of_a_node_outlives_it_and_all_is_counted(data: Path) -> None:
    """A grandchild with a session of its own, which computes for 1.5 s; `test_keeper` has a deaf one."""
    score = played(data, HIDING)
    assert score.failed is None
    pid = int((data.parent / "pid").read_text())
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    assert score.cpu_s > 2.0
