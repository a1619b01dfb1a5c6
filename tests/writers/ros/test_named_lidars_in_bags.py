"""A rig with an Ouster and a Livox by name, replayed into both bag formats, has what their drivers publish.

Fields, units and times are those of ouster-ros, livox_ros_driver (ROS 1) and livox_ros_driver2 (ROS 2).
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from shared_fixtures.drives.straight_drives import StraightDrive

from recorder.replaying.replay import replay

HEIGHT_M = 1.8
RIG = f"""\
name: two
sensors:
- {{kind: lidar, name: roof, preset: os1_64, mount: {{position_m: [0.0, 0.0, {HEIGHT_M}]}}}}
- {{kind: imu, name: os_imu, layout: ouster, rate_hz: 100, mount: {{position_m: [0.0, 0.0, {HEIGHT_M}]}}}}
- {{kind: lidar, name: front, preset: mid360, mount: {{position_m: [2.0, 0.0, {HEIGHT_M}]}}}}
- {{kind: imu, name: mid_imu, layout: livox, rate_hz: 200, mount: {{position_m: [2.0, 0.0, {HEIGHT_M}]}}}}
"""
OUSTER = [
    ("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("intensity", 16, 7), ("t", 20, 6), ("reflectivity", 24, 4),
    ("ring", 26, 4), ("ambient", 28, 4), ("range", 32, 6),
]  # fmt: skip
"""Names, offsets and sensor_msgs/PointField's datatypes."""
CLOUD = np.dtype({
    "names": [name for name, _, _ in OUSTER], "offsets": [offset for _, offset, _ in OUSTER],
    "formats": [{7: "<f4", 6: "<u4", 4: "<u2"}[kind] for _, _, kind in OUSTER], "itemsize": 48,
})  # fmt: skip


@pytest.fixture(scope="module")
def sequence(straight_drive: StraightDrive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of half a second."""
    out = tmp_path_factory.mktemp("named")
    (out / "two.yaml").write_text(RIG)
    config = straight_drive.config(
        out / "data", rig=str(out / "two.yaml"), formats=("rosbag1", "rosbag2"), topics="slam",
        start_s=1.0, duration_s=0.5, preview=False,
    )  # fmt: skip
    replay(config)
    (bag,) = (out / "data").rglob("*.bag")
    return bag.parent


@pytest.fixture(params=["rosbag1", "rosbag2"])
def messages(request: pytest.FixtureRequest, sequence: Path) -> dict[str, list[Any]]:
    """Messages by topic and type."""
    (bag,) = sequence.glob("*.bag") if request.param == "rosbag1" else sequence.glob("*/metadata.yaml")
    found: dict[str, list[Any]] = {"": [request.param]}
    with AnyReader([bag if request.param == "rosbag1" else bag.parent]) as reader:
        for connection, _, raw in reader.messages():
            key = f"{connection.topic} {connection.msgtype}"
            found.setdefault(key, []).append(reader.deserialize(raw, connection.msgtype))
    return found


def stamps_ns(messages: list[Any]) -> list[int]:
    return [one.header.stamp.sec * 10**9 + one.header.stamp.nanosec for one in messages]


def on_the_road(z_m: Any) -> float:
    """Share of points on the flat road, whose height is that of the mount in metres."""
    return float(np.mean(np.abs(z_m + HEIGHT_M) < 0.1))


def test_the_ouster(messages: dict[str, list[Any]]) -> None:
    clouds = messages["/ouster/points sensor_msgs/msg/PointCloud2"]
    assert np.diff(stamps_ns(clouds)).tolist() == [100_000_000] * (len(clouds) - 1)
    assert len(clouds) >= 4
    for cloud in clouds:
        assert cloud.header.frame_id == "os_lidar"
        assert [(field.name, field.offset, field.datatype) for field in cloud.fields] == OUSTER
        assert (cloud.height, cloud.width, cloud.point_step, cloud.is_dense) == (64, 1024, 48, False)
        rows = np.frombuffer(cloud.data.tobytes(), CLOUD).reshape(64, 1024)
        returned = np.isfinite(rows["x"])
        assert 0.2 < returned.mean() < 1.0
        assert (rows["ring"] == np.arange(64)[:, None]).all()
        # Columns of 97 656 ns; a row that looks aside is shifted by whole ones, and keeps its times.
        column = rows["t"].astype(float) * 1024 / 1e8
        assert np.abs(column - np.rint(column)).max() < 1e-4
        assert sorted(np.rint(column[0]).tolist()) == list(range(1024))
        size_m = np.linalg.norm([rows[axis][returned] for axis in "xyz"], axis=0)
        assert np.abs(rows["range"][returned] - 1e3 * size_m).max() <= 0.51
        assert 0.3 < on_the_road(rows["z"][returned]) < 0.95
        elevation = np.arcsin(rows["z"][returned] / size_m)
        assert elevation[rows["ring"][returned] == 0].mean() > elevation[rows["ring"][returned] == 63].mean()


def test_the_livox(messages: dict[str, list[Any]]) -> None:
    package = "livox_ros_driver" + {"rosbag1": "", "rosbag2": "2"}[messages[""][0]]
    sweeps = messages[f"/livox/lidar {package}/msg/CustomMsg"]
    assert len(sweeps) >= 4
    for sweep, stamp_ns in zip(sweeps, stamps_ns(sweeps), strict=True):
        assert (sweep.header.frame_id, sweep.timebase) == ("livox_frame", stamp_ns)
        assert sweep.point_num == len(sweep.points) == 20_000
        # Four lines 5 µs after each other, every 20 µs; FAST-LIO keeps points whose line is below 4.
        offset_ns = np.array([point.offset_time for point in sweep.points])
        assert (offset_ns == 5000 * np.arange(20_000)).all()
        assert ([point.line for point in sweep.points] == np.arange(20_000) % 4).all()
        assert {point.tag for point in sweep.points} == {0}
        xyz_m = np.array([(point.x, point.y, point.z) for point in sweep.points])
        returned = (xyz_m != 0).any(axis=1)
        assert 0.05 < returned.mean() < 0.95
        assert 0.05 < on_the_road(xyz_m[returned, 2]) < 0.95


def test_the_imus_inside(messages: dict[str, list[Any]]) -> None:
    """They stand at one height and turn together: in m/s² and in g, 100 and 200 times a second."""
    for topic, frame, unit_mps2, step_ns in (
        ("/ouster/imu", "os_imu", 1.0, 10_000_000),
        ("/livox/imu", "livox_frame", 9.81, 5_000_000),
    ):
        samples = messages[f"{topic} sensor_msgs/msg/Imu"]
        assert {one.header.frame_id for one in samples} == {frame}
        assert set(np.diff(stamps_ns(samples)).tolist()) == {step_ns}
        up = np.mean([one.linear_acceleration.z for one in samples])
        assert up * unit_mps2 == pytest.approx(9.81, abs=0.3)
