"""Files of trajectories, read as evo reads them."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Bag1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Bag2
from rosbags.typesys import Stores, get_typestore

from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.core.geometry import transforms
from recorder.dataset.trajectories import read_trajectory
from recorder.evaluation.evaluate import evaluate
from recorder.evaluation.trajectory import Trajectory
from recorder.evaluation.trajectory_files import write_tum

EPOCH_NS = 1_672_531_200_000_000_000


def drive(count: int = 60, step_ns: int = 100_000_000) -> Trajectory:
    """A bend over a hill, 10 Hz."""
    angle = np.linspace(0.0, 1.2, count)
    return Trajectory(
        stamp_ns=EPOCH_NS + np.arange(count, dtype=np.int64) * step_ns,
        position_m=np.stack([20 * np.sin(angle), 20 - 20 * np.cos(angle), np.sin(3 * angle)], axis=-1),
        quat_xyzw=transforms.rpy_to_quat(0.02 * angle, -0.1 * np.cos(3 * angle), angle),
        name="drive",
    )


def same(read: Trajectory, true: Trajectory, *, atol: float = 1e-9) -> None:
    assert read.stamp_ns.tolist() == true.stamp_ns.tolist()
    np.testing.assert_allclose(read.position_m, true.position_m, atol=atol)
    turn = np.abs(np.sum(read.quat_xyzw * true.quat_xyzw, axis=1))
    np.testing.assert_allclose(turn, 1.0, atol=atol)


def test_tum_with_a_byte_order_mark(tmp_path: Path) -> None:
    path = write_tum(tmp_path / "a.tum", drive())
    marked = tmp_path / "bom.txt"
    marked.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    same(read_trajectory(marked), drive())


def test_unsorted_tum_is_sorted_with_a_warning(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    lines = write_tum(tmp_path / "a.tum", drive()).read_text().splitlines()
    (tmp_path / "b.tum").write_text("\n".join([lines[0], *reversed(lines[1:])]))
    with caplog.at_level(logging.WARNING):
        same(read_trajectory(tmp_path / "b.tum"), drive())
    assert "sorted" in caplog.text


def test_kitti_as_evo_reads_it(tmp_path: Path) -> None:
    evo = pytest.importorskip("evo.tools.file_interface")
    truth = drive()
    rows = np.concatenate([transforms.quat_to_matrix(truth.quat_xyzw), truth.position_m[:, :, None]], axis=2)
    np.savetxt(tmp_path / "00.txt", rows.reshape(-1, 12), fmt="%.12e")
    with pytest.raises(EvaluationError, match="--times"):
        read_trajectory(tmp_path / "00.txt")
    (tmp_path / "times.txt").write_text(
        "\n".join(f"{(t - EPOCH_NS) / 1e9:.9f}" for t in truth.stamp_ns.tolist())
    )
    read = read_trajectory(tmp_path / "00.txt").shifted(EPOCH_NS)
    same(read, truth)
    theirs = evo.read_kitti_poses_file(str(tmp_path / "00.txt"))
    np.testing.assert_allclose(read.position_m, theirs.positions_xyz, atol=1e-9)
    wxyz = np.abs(np.sum(read.quat_xyzw[:, [3, 0, 1, 2]] * theirs.orientations_quat_wxyz, axis=1))
    np.testing.assert_allclose(wxyz, 1.0, atol=1e-9)
    (tmp_path / "short.txt").write_text("0.0\n0.1\n")
    with pytest.raises(EvaluationError, match="60 poses"):
        read_trajectory(tmp_path / "00.txt", times=tmp_path / "short.txt")


def test_euroc_table_as_evo_reads_it(tmp_path: Path) -> None:
    evo = pytest.importorskip("evo.tools.file_interface")
    truth = drive()
    rows = [
        f"{stamp},{','.join(map(repr, [*p, *np.roll(q, 1).tolist(), *[0.0] * 9]))}"
        for stamp, p, q in zip(
            truth.stamp_ns.tolist(), truth.position_m.tolist(), truth.quat_xyzw.tolist(), strict=True
        )
    ]
    (tmp_path / "data.csv").write_text("#timestamp, p_RS_R_x [m], ...\n" + "\n".join(rows) + "\n")
    read = read_trajectory(tmp_path / "data.csv")
    same(read, truth)
    theirs = evo.read_euroc_csv_trajectory(str(tmp_path / "data.csv"))
    np.testing.assert_allclose(read.position_m, theirs.positions_xyz)
    np.testing.assert_allclose(read.quat_xyzw[:, [3, 0, 1, 2]], theirs.orientations_quat_wxyz, atol=1e-12)


def _odometry(store: Any, stamp_ns: int, p: list[float], q: list[float], seq: dict[str, int]) -> Any:
    types = store.types
    header = types["std_msgs/msg/Header"](
        stamp=types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9),
        frame_id="map",
        **seq,
    )
    pose = types["geometry_msgs/msg/Pose"](
        position=types["geometry_msgs/msg/Point"](*p), orientation=types["geometry_msgs/msg/Quaternion"](*q)
    )
    zero = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    return types["nav_msgs/msg/Odometry"](
        header=header,
        child_frame_id="base_link",
        pose=types["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=np.zeros(36)),
        twist=types["geometry_msgs/msg/TwistWithCovariance"](
            twist=types["geometry_msgs/msg/Twist"](linear=zero, angular=zero), covariance=np.zeros(36)
        ),
    )


def _bag(path: Path, topics: tuple[str, ...], *, ros2: bool) -> Path:
    store = get_typestore(Stores.ROS2_HUMBLE if ros2 else Stores.ROS1_NOETIC)
    kind, truth = "nav_msgs/msg/Odometry", drive()
    bag: Any = Bag2(path, version=9, storage_plugin=StoragePlugin.MCAP) if ros2 else Bag1(path)
    with bag:
        for topic in topics:
            connection = bag.add_connection(topic, kind, typestore=store)
            for stamp, p, q in zip(
                truth.stamp_ns.tolist(), truth.position_m.tolist(), truth.quat_xyzw.tolist(), strict=True
            ):
                message = _odometry(store, stamp, p, q, {} if ros2 else {"seq": 0})
                data = store.serialize_cdr(message, kind) if ros2 else store.serialize_ros1(message, kind)
                bag.write(connection, stamp, data)
    return path


@pytest.mark.parametrize("ros2", [False, True])
def test_odometry_of_bags(tmp_path: Path, ros2: bool) -> None:
    path = _bag(tmp_path / ("one" if ros2 else "one.bag"), ("/odometry",), ros2=ros2)
    same(read_trajectory(path), drive())
    with pytest.raises(EvaluationError, match="did you mean '/odometry'"):
        read_trajectory(path, topic="/odometri")


def test_bag_with_several_topics_asks_for_one(tmp_path: Path) -> None:
    path = _bag(tmp_path / "two.bag", ("/a", "/b"), ros2=False)
    with pytest.raises(EvaluationError, match="--topic: /a, /b"):
        read_trajectory(path)
    same(read_trajectory(path, topic="/b"), drive())


def test_damaged_bag_is_named(tmp_path: Path) -> None:
    path = _bag(tmp_path / "one.bag", ("/odometry",), ros2=False)
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(EvaluationError, match=r"one\.bag"):
        read_trajectory(path)


@pytest.mark.parametrize("first", [0, 1])
def test_complete_estimate_covers_all(first: int) -> None:
    """A pose at the beginning or at the end of each of 60 sweeps, under a truth of 200 Hz."""
    truth = drive(1200, 5_000_000)
    every = np.arange(20 * first, 1200, 20)
    result = evaluate(truth, truth.take(every))
    assert result.coverage == 1.0
    half = evaluate(truth, truth.take(every[: len(every) // 2]))
    assert half.coverage == pytest.approx(0.5, abs=0.01)
