"""ROS 1 bags read back by rosbags: types, stamps, values, profiles, refusals."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from carlaloc_env.core import transforms as geometry
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import (
    DepthImage,
    GnssFix,
    Image,
    Imu,
    Odometry,
    PointCloud,
    Sample,
    SemanticImage,
    Speed,
)
from carlaloc_env.sensors.base import Mount
from recorder.writers.base import DEFAULT_EPOCH_NS
from recorder.writers.rig_calibration import (
    CameraCalibration,
    ImuCalibration,
    LidarCalibration,
    RigCalibration,
)
from recorder.writers.ros.rosbag1 import Rosbag1Writer

OFFICIAL_MD5 = {
    "sensor_msgs/msg/Imu": "6a62c6daae103f4ff57a132d6f95cec2",
    "sensor_msgs/msg/PointCloud2": "1158d486dd51d683ce2f1be655c3c181",
    "sensor_msgs/msg/Image": "060021388200f6f0f447d0fcd9c64743",
    "sensor_msgs/msg/NavSatFix": "2d3a8cd499b9b4a0249fb98fd05cfa48",
    "sensor_msgs/msg/CameraInfo": "c9a58c1b0b154e0e6da7578cb991d214",
    "nav_msgs/msg/Odometry": "cd5e73d190d741a2f92e81eda573aca7",
    "geometry_msgs/msg/TwistStamped": "98d34b0043a2093cf9d9345ab6eef12e",
    "geometry_msgs/msg/AccelStamped": "d8a98a5d81351b6eb0578c78557e7659",
    "rosgraph_msgs/msg/Clock": "a9c97c1d230cfc112e270351a944ee47",
    "tf2_msgs/msg/TFMessage": "94810edda583a504dfda3829e70d7eec",
}
"""Sums of the official ROS 1 definitions."""
PINHOLE = Pinhole(width_px=32, height_px=24, fx_px=16.0, fy_px=16.0, cx_px=16.0, cy_px=12.0)


def rig() -> RigCalibration:
    return RigCalibration.of(
        cameras=[
            CameraCalibration(
                name=side,
                T_base_camera=Mount(position_m=(1.8, y, 1.4), axes="optical").T_base_sensor,
                pinhole=PINHOLE,
            )
            for side, y in (("left", 0.2), ("right", -0.2))
        ],
        imu=ImuCalibration(T_base_imu=Mount(position_m=(1.5, 0, 1), axes="paper_imu").T_base_sensor),
        lidar=LidarCalibration(T_base_lidar=Mount(position_m=(1.2, 0, 1.8)).T_base_sensor),
    )


def cloud(stamp_ns: int, labelled: bool) -> PointCloud:
    rng = np.random.default_rng(stamp_ns)
    return PointCloud(
        sensor="lidar_semantic" if labelled else "lidar",
        frame_id="lidar",
        stamp_ns=stamp_ns,
        points_xyz_m=rng.normal(size=(50, 3)).astype(np.float32),
        intensity=rng.random(50, dtype=np.float32),
        ring=np.arange(50, dtype=np.uint16),
        offset_ns=np.arange(50, dtype=np.uint32) * 1_000_000,
        sweep_ns=50_000_000,
        tag=np.arange(50, dtype=np.uint8) if labelled else None,
        instance=np.arange(50, dtype=np.uint32) * 100_000 if labelled else None,
        cos_incidence=np.ones(50, np.float32) if labelled else None,
    )


def drive() -> list[Sample]:
    """A fifth of a second of every kind of sample, in the order of their stamps."""
    rng = np.random.default_rng(0)
    samples: list[Sample] = []
    for stamp in range(0, 200_000_000, 5_000_000):
        samples.append(
            Imu(
                sensor="imu",
                frame_id="imu",
                stamp_ns=stamp,
                specific_force_mps2=rng.normal(size=3),
                angular_rate_radps=rng.normal(size=3),
            )
        )
        quat = geometry.rpy_to_quat(0.1, -0.2, 1.0 + stamp * 1e-9)
        samples.append(
            Odometry(
                sensor="truth",
                frame_id="imu",
                stamp_ns=stamp,
                position_m=rng.normal(size=3),
                quat_xyzw=quat,
                velocity_world_mps=geometry.quat_rotate(quat, (5.0, 0.0, 0.5)),
                angular_rate_radps=np.array([0.0, 0.0, 1.0]),
            )
        )
        if stamp % 50_000_000 == 0:
            for side in ("left", "right"):
                frame = f"camera_{side}"
                rgb = rng.integers(0, 256, (24, 32, 3), dtype=np.uint8)
                tag = rng.integers(0, 29, (24, 32), dtype=np.uint8)
                samples += [
                    Image(sensor=f"rgb_{side}", frame_id=frame, stamp_ns=stamp, rgb=rgb),
                    DepthImage(
                        sensor=f"depth_{side}",
                        frame_id=frame,
                        stamp_ns=stamp,
                        depth_m=rng.random((24, 32), dtype=np.float32),
                    ),
                    SemanticImage(
                        sensor=f"semantic_{side}",
                        frame_id=frame,
                        stamp_ns=stamp,
                        tag=tag,
                        instance=tag.astype(np.uint32),
                    ),
                ]
            samples += [cloud(stamp, False), cloud(stamp, True)]
            samples.append(Speed(sensor="speed", frame_id="base_link", stamp_ns=stamp, speed_mps=-1.5))
        if stamp == 0:
            samples.append(
                GnssFix(
                    sensor="gnss",
                    frame_id="gnss",
                    stamp_ns=stamp,
                    latitude_deg=49.1,
                    longitude_deg=8.2,
                    altitude_m=110.0,
                    covariance_enu_m2=np.diag([9.0, 9.0, 25.0]),
                )
            )
    return samples


def read(path: Path) -> tuple[dict[str, tuple[str, str]], dict[str, list[tuple[int, Any]]]]:
    """Type and md5 of every topic, and its messages with their times."""
    with AnyReader([path]) as reader:
        types = {c.topic: (c.msgtype, c.digest) for c in reader.connections}
        messages: dict[str, list[tuple[int, Any]]] = {topic: [] for topic in types}
        for connection, time_ns, data in reader.messages():
            messages[connection.topic].append((time_ns, reader.deserialize(data, connection.msgtype)))
    return types, messages


@pytest.fixture(scope="module")
def standard(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bags") / "standard.bag"
    samples = drive()
    with Rosbag1Writer(path, rig(), streams={s.sensor for s in samples}, compression="lz4") as writer:
        for sample in samples:
            writer.write(sample)
        assert not path.exists()
    assert [p.name for p in path.parent.iterdir()] == ["standard.bag"]
    return path


def test_topics_types_and_official_sums(standard: Path) -> None:
    types, messages = read(standard)
    expected = {
        "/tf_static": ("tf2_msgs/msg/TFMessage", 1),
        "/clock": ("rosgraph_msgs/msg/Clock", 20),
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
            stamp = message.clock if topic == "/clock" else message.header.stamp
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
        assert (message.header.frame_id, message.child_frame_id) == ("world", "imu")


def test_cloud_layout_is_velodynes(standard: Path) -> None:
    _, messages = read(standard)
    message = messages["/lidar/points"][1][1]
    layout = [(f.name, f.offset, f.datatype) for f in message.fields]
    assert layout == [
        ("x", 0, 7),
        ("y", 4, 7),
        ("z", 8, 7),
        ("intensity", 12, 7),
        ("ring", 16, 4),
        ("time", 18, 7),
        ("label", 22, 2),
        ("id", 23, 6),
    ]
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


def test_paper_profile(tmp_path: Path) -> None:
    samples = drive()
    with Rosbag1Writer(tmp_path / "p.bag", rig(), profile="paper") as writer:
        for sample in samples:
            writer.write(sample)
    types, messages = read(tmp_path / "p.bag")
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
    with Rosbag1Writer(tmp_path / "a.bag", rig(), streams={"lidar"}) as writer:
        writer.write(cloud(0, False))
    _, messages = read(tmp_path / "a.bag")
    assert messages["/lidar/points"][0][1].point_step == 22


def test_lz4_chunks_have_the_flags_that_roslz4_reads(standard: Path) -> None:
    """Version 1, independent blocks, content checksum, nothing else: rosbags' own frames stop ROS 1."""
    flags = re.findall(rb"\x04\x22\x4d\x18(.)", standard.read_bytes(), flags=re.DOTALL)
    assert flags == [bytes([0b0110_0100])]


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
    samples = drive()
    path = tmp_path / "a.bag"
    with Rosbag1Writer(path, rig(), streams={s.sensor for s in samples}, compression=compression) as writer:
        for sample in samples:
            writer.write(sample)
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
        Rosbag1Writer(path, rig()).open()
    assert path.read_bytes() == b"mine"
    with pytest.raises(WriterError, match="did you mean 'paper'"):
        Rosbag1Writer(path, rig(), profile="papr")
    with pytest.raises(WriterError, match="lz4"):
        Rosbag1Writer(path, rig(), compression="zip")
    with pytest.raises(WriterError, match="after 0"):
        Rosbag1Writer(path, rig(), epoch_ns=0)
    with Rosbag1Writer(tmp_path / "b.bag", rig()) as writer:
        writer.write(cloud(100, False))
        with pytest.raises(WriterError, match="order of their stamps"):
            writer.write(cloud(99, False))


def test_failure_leaves_nothing_behind(tmp_path: Path) -> None:
    def crash() -> None:
        with Rosbag1Writer(tmp_path / "a.bag", rig()) as writer:
            writer.write(cloud(0, False))
            raise RuntimeError

    with pytest.raises(RuntimeError):
        crash()
    assert list(tmp_path.iterdir()) == []
