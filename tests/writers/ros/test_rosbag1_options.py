"""ROS 1 bags: profiles, compressions before ROS's own reader, refusals."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.readings.bag_samples import cloud, drive, read, rig, truth, write_all

from carlaloc_env.core import transforms
from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import Image
from recorder.dataset.trajectories import read_bag
from recorder.writers.base import Encoder, Writer
from recorder.writers.ros.rosbag1 import Ros1Encoder, Rosbag1Writer
from recorder.writers.ros.rosbag2 import Ros2Encoder, Rosbag2Writer


def test_paper_profile(tmp_path: Path) -> None:
    samples = drive()
    writer = Rosbag1Writer(tmp_path / "p.bag", Ros1Encoder(rig(), profile="paper"))
    types, messages = read(write_all(writer, samples))
    frames = {topic: entries[0][1].header.frame_id for topic, entries in messages.items()}
    assert frames == {"/imu": "imu", "/cam0_raw": "cam_left", "/cam1_raw": "cam_right", "/velodyne": "laser"}
    image = messages["/cam0_raw"][0][1]
    rgb = next(s for s in samples if isinstance(s, Image)).rgb.astype(np.float64)
    assert image.encoding == "mono8"
    brightness = rgb @ [0.299, 0.587, 0.114]
    assert np.abs(image.data.reshape(24, 32) - brightness).max() <= 1.0
    names = [field.name for field in messages["/velodyne"][0][1].fields]
    assert names == ["x", "y", "z", "intensity", "ring", "time"]
    assert len(types) == 4


def test_plain_cloud_alone_is_written(tmp_path: Path) -> None:
    writer = Rosbag1Writer(tmp_path / "a.bag", Ros1Encoder(rig(), streams={"lidar"}))
    _, messages = read(write_all(writer, [cloud(0, False)]))
    assert messages["/lidar/points"][0][1].point_step == 22


@pytest.mark.parametrize(
    ("name", "writer", "encoder"),
    [("a.bag", Rosbag1Writer, Ros1Encoder), ("a", Rosbag2Writer, Ros2Encoder)],
)
def test_sensors_can_be_placed_in_the_map(
    name: str, writer: Callable[..., Writer], encoder: Callable[..., Encoder], tmp_path: Path
) -> None:
    """`/tf` and `/tf_static` compose to each sensor's pose at every stamp of the odometry."""
    quats = transforms.rpy_to_quat(0.1, -0.2, 1.0), transforms.rpy_to_quat(0.0, 0.3, -2.0)
    moves = [truth(5_000_000 * k, (k, -2.0 * k, 0.5), quat) for k, quat in enumerate(quats)]
    path = write_all(writer(tmp_path / name, encoder(rig(), truth_tf=True, clock=True)), moves)
    types, messages = read(path)
    assert [message.clock.nanosec for _, message in messages["/clock"]] == [0]
    assert types["/tf"][0] == "tf2_msgs/msg/TFMessage"
    pairs = zip(messages["/tf"], messages["/ground_truth/odometry"], strict=True)
    for (at_ns, message), (odometry_ns, odometry) in pairs:
        (link,) = message.transforms
        assert at_ns == odometry_ns
        assert (link.header.frame_id, link.child_frame_id) == ("map", "base_link")
        assert link.header.stamp == odometry.header.stamp
        assert odometry.header.frame_id == "map"
    for frame, T_base_sensor in rig().frames.items():
        placed = read_bag(path, f"/tf:map.{frame}")
        for move, position_m, quat in zip(moves, placed.position_m, placed.quat_xyzw, strict=True):
            true = transforms.transform(move.position_m, move.quat_xyzw) @ T_base_sensor
            np.testing.assert_allclose(transforms.transform(position_m, quat), true, atol=1e-12)


_ROS = """
import json, sys, rosbag, roslib.message
import sensor_msgs.point_cloud2 as pc2
bag = rosbag.Bag(sys.argv[1])
info = bag.get_type_and_topic_info()
for kind, md5 in info.msg_types.items():
    assert roslib.message.get_message_class(kind)._md5sum == md5, kind
counts, times = {}, []
for topic, message, time in bag.read_messages():
    counts[topic] = counts.get(topic, 0) + 1
    times.append(time.to_nsec())
    if topic == "/lidar/points":
        points = list(pc2.read_points(message))
print(json.dumps([counts, times, points]))
"""


@pytest.mark.parametrize("compression", ["none", "lz4", "bz2"])
def test_ros_own_reader_agrees(tmp_path: Path, compression: str) -> None:
    """ROS 1's rosbag, where Debian's python3-rosbag is installed."""
    python = "/usr/bin/python3"
    needed = "import rosbag, sensor_msgs.point_cloud2, nav_msgs.msg, tf2_msgs.msg, rosgraph_msgs.msg"
    if not Path(python).exists() or subprocess.run([python, "-c", needed], capture_output=True).returncode:
        pytest.skip("needs Debian's python3-rosbag with its message packages")
    encoder = Ros1Encoder(rig(), streams={sample.sensor for sample in drive()})
    path = write_all(Rosbag1Writer(tmp_path / "a.bag", encoder, compression=compression), drive())
    done = subprocess.run([python, "-c", _ROS, str(path)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    counts, times, points = json.loads(done.stdout)
    _, messages = read(path)
    assert counts == {topic: len(entries) for topic, entries in messages.items()}
    assert times == sorted(time_ns for entries in messages.values() for time_ns, _ in entries)
    last = cloud(150_000_000, True)
    assert np.array_equal(np.array([p[:3] for p in points], np.float32), last.points_xyz_m)
    assert [p[4] for p in points] == last.ring.tolist()
    assert last.instance is not None
    assert [p[7] for p in points] == last.instance.tolist()


def test_refusals(tmp_path: Path) -> None:
    path = tmp_path / "a.bag"
    path.write_bytes(b"mine")
    with pytest.raises(WriterError, match="exists"):
        Rosbag1Writer(path, Ros1Encoder(rig())).open()
    assert path.read_bytes() == b"mine"
    with pytest.raises(WriterError, match="did you mean 'paper'"):
        Rosbag1Writer(path, Ros1Encoder(rig(), profile="papr"))
    with pytest.raises(WriterError, match="lz4"):
        Rosbag1Writer(path, Ros1Encoder(rig()), compression="zip")
    with pytest.raises(WriterError, match="after 0"):
        Rosbag1Writer(path, Ros1Encoder(rig(), epoch_ns=0))
    with Rosbag1Writer(tmp_path / "b.bag", Ros1Encoder(rig())) as writer:
        writer.write(cloud(100, False))
        with pytest.raises(WriterError, match="order of their stamps"):
            writer.write(cloud(99, False))
