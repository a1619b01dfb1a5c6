"""ROS 1 bags of the profile `standard` read back by rosbags: types, stamps, values."""

import re
from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.readings.bag_samples import cloud, drive, read, rig, write_all

from carlaloc_env.core import transforms as geometry
from carlaloc_env.samples import DepthImage, Image, Imu
from recorder.writers.base import DEFAULT_EPOCH_NS
from recorder.writers.ros.rosbag1 import Ros1Encoder, Rosbag1Writer

OFFICIAL_MD5 = {
    "sensor_msgs/msg/Imu": "6a62c6daae103f4ff57a132d6f95cec2",
    "sensor_msgs/msg/PointCloud2": "1158d486dd51d683ce2f1be655c3c181",
    "sensor_msgs/msg/Image": "060021388200f6f0f447d0fcd9c64743",
    "sensor_msgs/msg/NavSatFix": "2d3a8cd499b9b4a0249fb98fd05cfa48",
    "sensor_msgs/msg/CameraInfo": "c9a58c1b0b154e0e6da7578cb991d214",
    "nav_msgs/msg/Odometry": "cd5e73d190d741a2f92e81eda573aca7",
    "geometry_msgs/msg/TwistStamped": "98d34b0043a2093cf9d9345ab6eef12e",
    "geometry_msgs/msg/AccelStamped": "d8a98a5d81351b6eb0578c78557e7659",
    "tf2_msgs/msg/TFMessage": "94810edda583a504dfda3829e70d7eec",
}
"""Sums of the official ROS 1 definitions."""


@pytest.fixture(scope="module")
def standard(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bags") / "standard.bag"
    encoder = Ros1Encoder(rig(), streams={sample.sensor for sample in drive()})
    write_all(Rosbag1Writer(path, encoder, compression="lz4"), drive())
    assert [p.name for p in path.parent.iterdir()] == ["standard.bag"]
    return path


def test_topics_types_and_official_sums(standard: Path) -> None:
    types, messages = read(standard)
    expected = {
        "/tf_static": ("tf2_msgs/msg/TFMessage", 1),
        "/imu/data": ("sensor_msgs/msg/Imu", 40),
        "/ground_truth/odometry": ("nav_msgs/msg/Odometry", 40),
        "/ground_truth/acceleration": ("geometry_msgs/msg/AccelStamped", 40),
        "/lidar/points": ("sensor_msgs/msg/PointCloud2", 4),
        "/gnss/fix": ("sensor_msgs/msg/NavSatFix", 1),
        "/speed": ("geometry_msgs/msg/TwistStamped", 4),
    }
    for side in ("left", "right"):
        for name in ("image_raw", "depth", "semantic"):
            expected[f"/camera/{side}/{name}"] = ("sensor_msgs/msg/Image", 4)
        expected[f"/camera/{side}/camera_info"] = ("sensor_msgs/msg/CameraInfo", 4)
    assert {topic: (types[topic][0], len(m)) for topic, m in messages.items()} == expected
    for topic, (kind, digest) in types.items():
        assert digest == OFFICIAL_MD5[kind], topic


def test_stamps_are_exact(standard: Path) -> None:
    _, messages = read(standard)
    for topic, entries in messages.items():
        for time_ns, message in entries:
            if topic == "/tf_static":
                continue
            stamp = message.header.stamp
            assert stamp.sec * 10**9 + stamp.nanosec == time_ns, topic
    imu = [time_ns for time_ns, _ in messages["/imu/data"]]
    assert imu == [DEFAULT_EPOCH_NS + k * 5_000_000 for k in range(40)]
    assert [m.header.seq for _, m in messages["/imu/data"]] == list(range(40))
    left = [t for t, _ in messages["/camera/left/image_raw"]]
    assert left == [t for t, _ in messages["/camera/right/image_raw"]]


def test_values_survive(standard: Path) -> None:
    _, messages = read(standard)
    samples = drive()
    for (_, message), sample in zip(
        messages["/imu/data"], (s for s in samples if isinstance(s, Imu)), strict=True
    ):
        force, rate = message.linear_acceleration, message.angular_velocity
        assert [force.x, force.y, force.z] == sample.specific_force_mps2.tolist()
        assert [rate.x, rate.y, rate.z] == sample.angular_rate_radps.tolist()
        assert message.orientation_covariance[0] == -1.0
    image = next(s for s in samples if isinstance(s, Image))
    message = messages["/camera/left/image_raw"][0][1]
    assert (message.encoding, message.step, message.height) == ("rgb8", 96, 24)
    assert message.data.tobytes() == image.rgb.tobytes()
    depth = next(s for s in samples if isinstance(s, DepthImage))
    message = messages["/camera/left/depth"][0][1]
    assert (message.encoding, message.step) == ("32FC1", 128)
    assert message.data.tobytes() == depth.depth_m.tobytes()
    info = messages["/camera/left/camera_info"][0][1]
    assert info.K.tolist() == [16, 0, 16, 0, 16, 12, 0, 0, 1]
    fix = messages["/gnss/fix"][0][1]
    assert (fix.status.status, fix.status.service, fix.position_covariance_type) == (0, 1, 2)
    assert fix.position_covariance.tolist() == [9, 0, 0, 0, 9, 0, 0, 0, 25]
    assert messages["/speed"][0][1].twist.linear.x == -1.5


def test_odometry_twist_is_in_the_child_frame(standard: Path) -> None:
    _, messages = read(standard)
    for _, message in messages["/ground_truth/odometry"]:
        linear = message.twist.twist.linear
        assert np.allclose([linear.x, linear.y, linear.z], [5.0, 0.0, 0.5], atol=1e-12)
        assert (message.header.frame_id, message.child_frame_id) == ("map", "imu")


def test_cloud_layout_is_velodynes(standard: Path) -> None:
    _, messages = read(standard)
    message = messages["/lidar/points"][1][1]
    layout = [(f.name, f.offset, f.datatype) for f in message.fields]
    assert layout == [
        ("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("intensity", 12, 7), ("ring", 16, 4), ("time", 18, 7),
        ("label", 22, 2), ("id", 23, 6),
    ]  # fmt: skip
    assert (message.point_step, message.height, message.width, message.row_step) == (27, 1, 50, 1350)
    assert message.is_dense is True
    raw = message.data.tobytes()
    sample = cloud(50_000_000, True)
    for k in (0, 7, 49):
        row = raw[27 * k : 27 * k + 27]
        assert np.frombuffer(row[:12], "<f4").tolist() == sample.points_xyz_m[k].tolist()
        assert np.frombuffer(row[16:18], "<u2")[0] == k
        assert np.frombuffer(row[18:22], "<f4")[0] == pytest.approx(k * 1e-3, rel=1e-6)
        assert row[22] == k
        assert np.frombuffer(row[23:27], "<u4")[0] == k * 100_000


def test_tf_static_agrees_with_the_mounts(standard: Path) -> None:
    _, messages = read(standard)
    transforms = messages["/tf_static"][0][1].transforms
    found = {}
    for t in transforms:
        assert t.header.frame_id == "base_link"
        p, q = t.transform.translation, t.transform.rotation
        found[t.child_frame_id] = geometry.transform((p.x, p.y, p.z), (q.x, q.y, q.z, q.w))
    assert set(found) == {"camera_left", "camera_right", "imu", "lidar"}
    for frame, T in rig().frames.items():
        assert np.allclose(found[frame], T, atol=1e-12)


def test_lz4_chunks_have_the_flags_that_roslz4_reads(standard: Path) -> None:
    """Version 1, independent blocks, content checksum, nothing else: rosbags' own frames stop ROS 1."""
    flags = re.findall(rb"\x04\x22\x4d\x18(.)", standard.read_bytes(), flags=re.DOTALL)
    assert flags == [bytes([0b0110_0100])]
