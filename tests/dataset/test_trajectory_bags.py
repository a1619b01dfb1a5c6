"""Trajectories in bags: every type of message, paths, trees of frames, and what is said of other bags."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared_fixtures.readings.pose_bags import ODOMETRY, PATH, POSES, TF, Entry, Messages
from shared_fixtures.readings.short_drive import EPOCH_NS, assert_same, drive

from carlaloc_env.core import transforms
from carlaloc_env.core.errors import EvaluationError
from recorder.dataset.trajectories import read_trajectory
from recorder.evaluation.trajectory import Trajectory

ROS1 = Messages(ros2=False)


def _stream(topic: str, kind: str, messages: list[Any]) -> list[Entry]:
    return [(topic, kind, at, m) for at, m in zip(drive().stamp_ns.tolist(), messages, strict=True)]


@pytest.mark.parametrize("ros2", [False, True])
@pytest.mark.parametrize("kind", POSES)
def test_every_type_of_pose(tmp_path: Path, kind: str, ros2: bool) -> None:
    make = Messages(ros2=ros2)
    path = make.write(
        tmp_path / ("one" if ros2 else "one.bag"), _stream("/odometry", kind, make.poses(kind, drive()))
    )
    assert_same(read_trajectory(path), drive())
    with pytest.raises(EvaluationError, match="did you mean '/odometry'"):
        read_trajectory(path, topic="/odometri")


def test_bag_with_several_topics_asks_for_one(tmp_path: Path) -> None:
    poses = ROS1.poses(ODOMETRY, drive())
    path = ROS1.write(
        tmp_path / "two.bag", [*_stream("/a", ODOMETRY, poses), *_stream("/b", ODOMETRY, poses)]
    )
    with pytest.raises(EvaluationError, match="--topic: /a, /b"):
        read_trajectory(path)
    assert_same(read_trajectory(path, topic="/b"), drive())


def test_a_bag_without_poses_is_told_what_is_read(tmp_path: Path) -> None:
    path = ROS1.write(tmp_path / "a.bag", [("/head", "std_msgs/msg/Header", EPOCH_NS, ROS1.header(0))])
    with pytest.raises(
        EvaluationError, match=r"read are nav_msgs/Odometry, .*tf2_msgs/TFMessage; .* std_msgs/Header"
    ):
        read_trajectory(path)


def test_messages_without_stamps_get_those_of_recording(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    poses = ROS1.poses(POSES[1], drive(), stamped=False)
    assert_same(read_trajectory(ROS1.write(tmp_path / "a.bag", _stream("/pose", POSES[1], poses))), drive())
    assert "have no stamps" in caplog.text


def test_poses_of_two_bodies_on_a_topic_are_reported(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    poses = ROS1.poses(POSES[3], drive())
    for message in poses[1::2]:
        message.child_frame_id = "other"
    read_trajectory(ROS1.write(tmp_path / "a.bag", _stream("/vicon", POSES[3], poses)))
    assert "several frames (map to base_link, map to other)" in caplog.text


def test_the_last_path_counts_and_odometry_before_it(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A path is corrected with every message: the last one is what the system ends with."""
    wrong = ROS1.poses(
        POSES[1], drive().take(np.arange(30)).of_sensor(transforms.transform((3, 0, 0), (0, 0, 0, 1)))
    )
    right = ROS1.poses(POSES[1], drive())
    paths = [
        ("/path", PATH, EPOCH_NS, ROS1.path(0, wrong)),
        ("/path", PATH, EPOCH_NS + 1, ROS1.path(0, right)),
    ]
    assert_same(read_trajectory(ROS1.write(tmp_path / "a.bag", paths)), drive())
    assert caplog.text == ""
    both = [*paths, *_stream("/odometry", ODOMETRY, ROS1.poses(ODOMETRY, drive().shifted(7)))]
    path = ROS1.write(tmp_path / "b.bag", both)
    assert_same(read_trajectory(path), drive().shifted(7))
    assert "poses of /odometry are read; --topic takes another of /odometry, /path" in caplog.text
    assert_same(read_trajectory(path, topic="/path"), drive())


@pytest.mark.parametrize("stamped", [True, False])
def test_paths_that_forget_and_paths_without_stamps(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, stamped: bool
) -> None:
    poses = ROS1.poses(POSES[1], drive(), stamped=stamped)
    stamps = drive().stamp_ns.tolist()
    first = [0] * 60 if not stamped else [max(i - 4, 0) for i in range(60)]
    paths = [("/path", PATH, stamps[i] + 5, ROS1.path(stamps[i], poses[first[i] : i + 1])) for i in range(60)]
    assert_same(read_trajectory(ROS1.write(tmp_path / "a.bag", paths)), drive())
    assert ("forget their beginning" if stamped else "of each message the last pose") in caplog.text


def _tree(tmp_path: Path) -> Path:
    """A map that slips under odometry once a second, a car, a fixed LiDAR, and a wheel that turns."""
    count = 60
    zero = np.zeros(count)
    slow = [*range(0, count, 10), count - 1]
    wheel = Trajectory(
        stamp_ns=drive().stamp_ns, position_m=np.tile([0.0, 0.8, 0.3], (count, 1)),
        quat_xyzw=transforms.rpy_to_quat(zero, np.linspace(0.0, 30.0, count), zero),
    )  # fmt: skip
    correction = drive().take(np.array(slow))
    slipped = Trajectory(
        stamp_ns=correction.stamp_ns, position_m=np.tile([5.0, -2.0, 0.0], (len(slow), 1)),
        quat_xyzw=np.tile(transforms.rpy_to_quat(0.0, 0.0, 0.5), (len(slow), 1)),
    )  # fmt: skip
    mount = Trajectory(
        stamp_ns=np.array([0]), position_m=np.array([[1.0, 0.0, 2.0]]),
        quat_xyzw=np.array([transforms.rpy_to_quat(0.1, 0.0, 1.0)]),
    )  # fmt: skip
    entries = [
        ("/tf", TF, at, message)
        for of, parent, child in (
            (drive(), "odom", "base_link"), (slipped, "map", "odom"), (wheel, "/base_link", "wheel")
        )
        for at, message in ROS1.links(of, parent, child)
    ]  # fmt: skip
    static = [("/tf_static", TF, EPOCH_NS, message) for _, message in ROS1.links(mount, "base_link", "lidar")]
    return ROS1.write(tmp_path / "tree.bag", [*entries, *static])


def _in_map(of: Trajectory) -> Trajectory:
    T_map_odom = transforms.transform((5.0, -2.0, 0.0), transforms.rpy_to_quat(0.0, 0.0, 0.5))
    return Trajectory(
        stamp_ns=of.stamp_ns,
        position_m=transforms.apply(T_map_odom, of.position_m),
        quat_xyzw=transforms.quat_multiply(transforms.matrix_to_quat(T_map_odom[:3, :3]), of.quat_xyzw),
    )


def test_a_tree_of_frames(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = _tree(tmp_path)
    assert_same(read_trajectory(path), _in_map(drive()))
    assert "/tf:map.base_link is read; --topic takes another of" in caplog.text
    assert_same(read_trajectory(path, topic="/tf:odom.base_link"), drive())
    lidar = drive().of_sensor(transforms.transform((1.0, 0.0, 2.0), transforms.rpy_to_quat(0.1, 0.0, 1.0)))
    assert_same(read_trajectory(path, topic="/tf:map.lidar"), _in_map(lidar))
    with pytest.raises(EvaluationError, match=r"did you mean 'map\.base_link'"):
        read_trajectory(path, topic="/tf:map.base_lin")


def test_frames_that_are_no_tree_are_named(tmp_path: Path) -> None:

    def bag(name: str, *pairs: tuple[str, str]) -> Path:
        return ROS1.write(
            tmp_path / name, [("/tf", TF, at, m) for pair in pairs for at, m in ROS1.links(drive(), *pair)]
        )

    with pytest.raises(EvaluationError, match="frame car has two parents, map and odom"):
        read_trajectory(bag("a.bag", ("map", "car"), ("odom", "car")))
    with pytest.raises(EvaluationError, match="lies below itself"):
        read_trajectory(bag("b.bag", ("map", "car"), ("car", "map")))
