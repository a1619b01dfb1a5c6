"""Messages of LiDARs' drivers in bags of ROS 1 and 2, beside a table of what the drivers publish.

The table is of the drivers' sources: velodyne_pointcloud, ouster-ros and ouster_example, HesaiLidar_ROS_2.0,
rslidar_sdk, livox_ros_driver and livox_ros_driver2, and of HeLiPR's file player.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import Imu, PointCloud
from carlaloc_env.sensors.base import Mount, SensorConfig
from carlaloc_env.sensors.imu import ImuConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from recorder.dataset.clouds import read_cloud
from recorder.dataset.point_times import time_rule
from recorder.writers.driver_layouts import driver_frames
from recorder.writers.rig_calibration import RigCalibration
from recorder.writers.ros.message_parts import make_typestore
from recorder.writers.ros.rosbag1 import Ros1Encoder, Rosbag1Writer
from recorder.writers.ros.rosbag2 import Ros2Encoder, Rosbag2Writer
from recorder.writers.topic_profiles import profile_for

EPOCH_NS = 1_700_000_000_123_456_789
"""Time of the drive's beginning."""
TYPES = {2: "u1", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""sensor_msgs/PointField's datatypes."""
XYZI = "x f4 0, y f4 4, z f4 8, intensity f4 12"
PCL = "x f4 0, y f4 4, z f4 8, intensity f4 16"
OUSTER = PCL + ", t u4 20, reflectivity u2 24, ring {} 26, ambient u2 28, range u4 32"
POINTS, LIVOX = "sensor_msgs/msg/PointCloud2", "livox_ros_driver{}/msg/CustomMsg"
CUSTOM = "offset_time u4 0, x f4 4, y f4 8, z f4 12, reflectivity u1 16, tag u1 17, line u1 18"


@dataclass(frozen=True)
class Driver:
    """What a driver publishes."""

    preset: str
    topic: str
    frame: str
    fields: str
    """Name, type and offset of each field."""
    step: int
    unit_ns: float
    """Unit of the field of times."""
    absolute: bool
    """Whether times count from 1970, not from the header's stamp."""
    from_top: bool
    """Whether ring 0 is the highest beam."""
    dense: bool = True
    empty: float | None = None
    """Coordinates of rays without a return; None: they are left out."""
    kinds: tuple[str, str] = (POINTS, POINTS)
    """Types of messages in ROS 1 and ROS 2."""
    time: str = "t"
    ring: str = "ring"


DRIVERS = {
    "velodyne": Driver("vlp16", "/velodyne_points", "velodyne", XYZI + ", ring u2 16, time f4 18",
                       22, 1e9, False, False, time="time"),
    "velodyne us": Driver("vlp16", "/velodyne_points", "velodyne", XYZI + ", ring u2 16, time f4 18",
                          22, 1e3, False, False, time="time"),
    "ouster": Driver("os1_64", "/ouster/points", "os_lidar", OUSTER.format("u2"),
                     48, 1, False, True, dense=False, empty=np.nan),
    "ouster_2021": Driver("os1_64", "/os_cloud_node/points", "os_sensor", OUSTER.format("u1"),
                          48, 1, False, True, empty=0.0),
    "hesai": Driver("pandar_xt32", "/lidar_points", "hesai_lidar", XYZI + ", ring u2 16, timestamp f8 18",
                    26, 1e9, True, True, dense=False, time="timestamp"),
    "robosense": Driver("helios_32", "/rslidar_points", "rslidar", XYZI + ", ring u2 16, timestamp f8 18",
                        26, 1e9, True, False, dense=False, empty=np.nan, time="timestamp"),
    "livox": Driver("mid360", "/livox/lidar", "livox_frame", CUSTOM, 19, 1, False, True, empty=0.0,
                    kinds=(LIVOX.format(""), LIVOX.format("2")), time="offset_time", ring="line"),
    "livox_ros_driver": Driver("avia", "/livox/lidar", "livox_frame", CUSTOM, 19, 1, False, True,
                               empty=0.0, kinds=(LIVOX.format(""),) * 2, time="offset_time", ring="line"),
    "livox_ros_driver2": Driver("avia", "/livox/lidar", "livox_frame", CUSTOM, 19, 1, False, True,
                                empty=0.0, kinds=(LIVOX.format("2"),) * 2, time="offset_time", ring="line"),
    "livox_points": Driver("mid360", "/livox/lidar", "livox_frame",
                           XYZI + ", tag u1 16, line u1 17, timestamp f8 18",
                           26, 1, True, True, empty=0.0, time="timestamp", ring="line"),
    "aeva": Driver("aeries2", "/aeva/points", "aeva",
                   PCL + ", reflectivity f4 20, velocity f4 24, time_offset_ns i4 28, line_index u1 32",
                   48, 1, False, False, time="time_offset_ns", ring="line_index"),
}  # fmt: skip


def lidar(layout: str) -> LidarConfig:
    """The LiDAR of a row of the table, with an eighth of its columns."""
    name, _, unit = layout.partition(" ")
    values = LidarConfig.preset_values(DRIVERS[layout].preset) | {"layout": name}
    values |= {"columns": values["columns"] // 8, "cycle_ns": 8 * values.get("cycle_ns", 0.0)}
    return LidarConfig(**values, name="top", mount=Mount(position_m=(1.0, 0.0, 1.8)), time_unit=unit or "s")


def sweep(config: LidarConfig, stamp_ns: int) -> tuple[PointCloud, int]:
    """A sweep of which every seventh ray has no return, and the number of its rays.

    Columns follow each other without a gap from the beginning of the drive on; they go clockwise from
    straight behind.
    """
    column_ns = config.sweep_ns / float(config.columns_per_sweep)
    first, end = (int(np.ceil(at_ns / column_ns - 1e-6)) for at_ns in (stamp_ns, stamp_ns + config.sweep_ns))
    number = np.arange(first, end)
    firing_ns = np.array(config.firing_ns or (0,) * config.rings)
    offset_ns = np.rint(number[:, None] * column_ns - stamp_ns + firing_ns)
    turn = (np.arange(end - first) + 0.5)[:, None] / (end - first)
    azimuth = np.pi - 2 * np.pi * turn + np.radians(config.azimuth_offsets_deg or (0.0,) * config.rings)
    elevation = np.radians(config.elevations_deg) + 0 * azimuth
    range_m = 10.0 + 0.1 * np.arange(config.rings) + 0.001 * np.arange(len(azimuth))[:, None]
    flat = range_m * np.cos(elevation)
    xyz = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), range_m * np.sin(elevation)], axis=-1)
    beam = np.arange(config.rings) + 0 * offset_ns.astype(int)
    ring = config.rings - 1 - beam if config.rings_from_top else beam
    order = np.argsort(offset_ns, axis=None, kind="stable")
    kept = order[np.arange(offset_ns.size) % 7 > 0]
    count = len(kept)
    cloud = PointCloud(
        sensor="top", frame_id="top", stamp_ns=stamp_ns, sweep_ns=config.sweep_ns,
        points_xyz_m=xyz.reshape(-1, 3)[kept].astype(np.float32),
        intensity=(np.arange(count) % 256).astype(np.float32),
        ring=ring.reshape(-1)[kept].astype(np.uint16),
        offset_ns=offset_ns.reshape(-1)[kept].astype(np.uint32),
        doppler_mps=np.linspace(-9, 9, count, dtype=np.float32) if config.doppler else None,
    )  # fmt: skip
    return cloud, offset_ns.size


def written(folder: Path, ros: int, sensors: list[SensorConfig], *samples: Any) -> Path:
    """A bag of samples, as a replay writes it."""
    calibration = RigCalibration.from_configs(sensors)
    streams = {sample.sensor for sample in samples}
    if ros == 1:
        with Rosbag1Writer(
            folder / "x.bag", Ros1Encoder(calibration, streams=streams, epoch_ns=EPOCH_NS)
        ) as bag:
            for sample in samples:
                bag.write(sample)
        return folder / "x.bag"
    with Rosbag2Writer(folder / "x", Ros2Encoder(calibration, streams=streams, epoch_ns=EPOCH_NS)) as bag2:
        for sample in samples:
            bag2.write(sample)
    return folder / "x"


def read(bag: Path) -> Iterator[tuple[Any, Any, bytes]]:
    """Connection, message and bytes of all messages, read by rosbags with the definitions in the bag."""
    with AnyReader([bag]) as reader:
        for connection, _, raw in reader.messages():
            yield connection, reader.deserialize(raw, connection.msgtype), bytes(raw)


def rows_of(message: Any) -> NDArray[np.void]:
    """Rows of a PointCloud2 by its own description, or of a Livox message."""
    if hasattr(message, "timebase"):
        names = ("offset_time", "x", "y", "z", "reflectivity", "tag", "line")
        dtype = np.dtype([(word.split()[0], "<" + word.split()[1]) for word in CUSTOM.split(", ")])
        return np.array([tuple(getattr(point, name) for name in names) for point in message.points], dtype)
    fields = message.fields
    layout: Any = {
        "names": [f.name for f in fields], "formats": ["<" + TYPES[f.datatype] for f in fields],
        "offsets": [f.offset for f in fields], "itemsize": message.point_step,
    }  # fmt: skip
    assert message.row_step == message.width * message.point_step
    return np.frombuffer(message.data.tobytes(), np.dtype(layout)).reshape(message.height, message.width)


def by_place(rows: NDArray[np.void]) -> NDArray[np.void]:
    """Rows with a return, in the order of their coordinates."""
    flat = rows.reshape(-1)
    size = np.abs(flat["x"]) + np.abs(flat["y"]) + np.abs(flat["z"])
    flat = flat[np.isfinite(size) & (size > 0)]
    return flat[np.lexsort((flat["z"], flat["y"], flat["x"]))]


@pytest.mark.parametrize("ros", [1, 2])
@pytest.mark.parametrize("layout", DRIVERS)
def test_messages_are_the_drivers(layout: str, ros: int, tmp_path: Path) -> None:
    """The second sweep, which begins with a part of a column where columns are no whole number."""
    driver, config = DRIVERS[layout], lidar(layout)
    cloud, rays = sweep(config, config.sweep_ns)
    messages = [
        item for item in read(written(tmp_path, ros, [config], cloud)) if item[0].topic == driver.topic
    ]
    ((connection, message, _),) = messages
    stamp_ns = EPOCH_NS + config.sweep_ns
    assert connection.msgtype == driver.kinds[ros - 1]
    assert message.header.frame_id == driver.frame
    assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == stamp_ns
    rows = rows_of(message)
    described = ", ".join(
        f"{name} {kind.str[1:]} {offset}" for name, (kind, offset) in (rows.dtype.fields or {}).items()
    )
    assert (described, rows.dtype.itemsize) == (driver.fields, driver.step)
    if driver.kinds[0] == POINTS:
        assert (message.is_dense, message.is_bigendian) == (driver.dense, False)
    else:
        assert (message.timebase, message.point_num, len(message.points)) == (stamp_ns, rays, rays)
    assert rows.size == (rays if driver.empty is not None else len(cloud.ring))
    empty = [np.isnan(rows[axis]) if driver.empty != 0.0 else rows[axis] == 0.0 for axis in "xyz"]
    assert np.all(empty, axis=0).sum() == (rays - len(cloud.ring) if driver.empty is not None else 0)

    true = np.rec.fromarrays(
        [*cloud.points_xyz_m.T, cloud.ring, cloud.offset_ns, cloud.intensity],
        names="x, y, z, ring, offset_ns, intensity",
    )
    found, true = by_place(rows), by_place(true)
    assert all((found[axis] == true[axis]).all() for axis in "xyz")
    assert (found[driver.ring] == true["ring"]).all()
    assert (
        found["reflectivity" if "livox_ros" in connection.msgtype else "intensity"] == true["intensity"]
    ).all()
    highest = found[np.argmax(found["z"] / np.hypot(found["x"], found["y"]))]
    assert highest[driver.ring] == (0 if driver.from_top else config.rings - 1)
    zero_ns = stamp_ns if driver.absolute else 0
    time_ns = (found[driver.time].astype(np.longdouble) * driver.unit_ns - zero_ns).astype(float)
    # Half a unit in the last place: of 0.1 s in single precision, of times since 1970 in double.
    rounded_ns = 130 if driver.absolute else 0 if rows.dtype[driver.time].kind in "ui" else 4
    assert np.abs(time_ns - true["offset_ns"]).max() <= rounded_ns
    if driver.empty is not None and config.pattern is None:
        all_ns = rows[driver.time].astype(float) * driver.unit_ns - zero_ns
        assert -1e3 < all_ns.min() < all_ns.max() < config.sweep_ns + 1e5


@pytest.mark.parametrize("ros", [1, 2])
@pytest.mark.parametrize("layout", DRIVERS)
def test_our_reader_finds_the_times(layout: str, ros: int, tmp_path: Path) -> None:
    """`carlaloc odometry` reads every layout: unit and zero of times follow from the first clouds."""
    config = lidar(layout)
    clouds = [sweep(config, k * config.sweep_ns)[0] for k in range(3)]
    with AnyReader([written(tmp_path, ros, [config], *clouds)]) as reader:
        mine = [c for c in reader.connections if c.topic == DRIVERS[layout].topic]
        found = [read_cloud(reader, connection, raw) for connection, _, raw in reader.messages(mine)]
    rule = time_rule(found, "bag")
    for cloud, one in zip(clouds, found, strict=True):
        first_ns, time_s = rule.read(one)
        at_ns = np.sort(first_ns - EPOCH_NS + 1e9 * time_s)
        assert np.abs(at_ns - cloud.stamp_ns - cloud.offset_ns).max() < 1e3
        assert (one.doppler_mps is None) == (cloud.doppler_mps is None)
        if one.doppler_mps is not None and cloud.doppler_mps is not None:
            np.testing.assert_array_equal(np.sort(one.doppler_mps), np.sort(cloud.doppler_mps))


def rows_made(config: LidarConfig, stamp_ns: int) -> Any:
    """Rows of a sweep's message."""
    encoder = Ros1Encoder(RigCalibration.from_configs([config]), epoch_ns=EPOCH_NS)
    return rows_of(encoder.maker.make(f"points_{config.layout}", sweep(config, stamp_ns)[0], "/x"))


@pytest.mark.parametrize("layout", ["ouster", "ouster_2021"])
def test_columns_of_an_ouster_show_one_azimuth(layout: str) -> None:
    """They do, though beams look 4.2° aside; rows are rings from the top."""
    rows = rows_made(lidar(layout), 0)
    assert rows.shape == (64, 128)
    assert (rows["ring"] == np.arange(64)[:, None]).all()
    azimuth = np.where(rows["range"] > 0, np.arctan2(rows["y"], rows["x"]), np.nan)
    middle = np.pi - 2 * np.pi * (np.arange(128) + 0.5) / 128
    away = np.angle(np.exp(1j * (azimuth - middle)))
    # Shifts are whole columns: half of one is left at most.
    assert np.nanmax(np.abs(away)) <= np.pi / 128 + 1e-6
    range_mm = 1e3 * np.linalg.norm([rows[axis] for axis in "xyz"], axis=0)
    assert np.nanmax(np.abs(rows["range"] - range_mm)) <= 0.501


def test_rows_of_a_robosense_are_columns() -> None:
    config = lidar("robosense")
    rows = rows_made(config, config.sweep_ns)
    assert rows.shape[1] == 32
    steps_ns = 1e9 * np.diff(rows["timestamp"].astype(np.longdouble), axis=1)
    assert np.abs(steps_ns - 1730).max() < 500


def test_nothing_returned() -> None:
    """A sweep without a point is a message of empty rays."""
    for layout in ("ouster", "robosense", "livox_points"):
        config = lidar(layout)
        cloud, rays = sweep(config, 0)
        none = {name: getattr(cloud, name)[:0] for name in ("points_xyz_m", "intensity", "ring", "offset_ns")}
        encoder = Ros2Encoder(RigCalibration.from_configs([config]), epoch_ns=EPOCH_NS)
        rows = rows_of(encoder.maker.make(f"points_{layout.removeprefix('livox_points') or 'livox'}",
                                          replace(cloud, **none), "/x"))  # fmt: skip
        assert rows.size == rays


def test_definitions_of_livox() -> None:
    """MD5 sums of ROS 1 as its driver's nodes show them, and ROS 2's hashes by rosbags' own rule."""
    for package in ("livox_ros_driver", "livox_ros_driver2"):
        md5 = make_typestore(Stores.ROS1_NOETIC).generate_msgdef(f"{package}/msg/CustomMsg")[1]
        assert md5 == "e4d6829bdfe657cb6c21a746c86b21a6"
    digest = make_typestore(Stores.ROS2_HUMBLE).hash_rihs01("livox_ros_driver2/msg/CustomMsg")
    assert digest.endswith("2eb17e5e35bf5a2d6cd079f3c57f33abf95e5bf7d71b42cddc05daace73d815a")


@pytest.mark.parametrize(
    ("layout", "topic", "frame", "unit_mps2"),
    [
        ("ouster", "/ouster/imu", "os_imu", 1.0),
        ("ouster_2021", "/os_cloud_node/imu", "os_imu", 1.0),
        ("hesai", "/lidar_imu", "hesai_lidar", 1.0),
        ("robosense", "/rslidar_imu_data", "rslidar", 9.81),
        ("livox", "/livox/imu", "livox_frame", 9.81),
    ],
)
@pytest.mark.parametrize("ros", [1, 2])
def test_imus(layout: str, topic: str, frame: str, unit_mps2: float, ros: int, tmp_path: Path) -> None:
    """The IMU inside: topic, frame and unit, beside our own message in m/s²."""
    config = ImuConfig(name="inner", layout=layout, rate_hz=200.0, accel_noise_density=1e-3)
    sample = Imu(
        sensor="inner", frame_id="inner", stamp_ns=0, specific_force_mps2=np.array([0.0, 1.962, 9.81]),
        angular_rate_radps=np.array([0.1, 0.2, 0.3]),
    )  # fmt: skip
    by_topic = {c.topic: message for c, message, _ in read(written(tmp_path, ros, [config], sample))}
    message, ours = by_topic[topic], by_topic["/inner/data"]
    assert (message.header.frame_id, ours.header.frame_id) == (frame, "inner")
    force = [message.linear_acceleration.x, message.linear_acceleration.y, message.linear_acceleration.z]
    assert np.array(force) * unit_mps2 == pytest.approx([0.0, 1.962, 9.81])
    assert ours.linear_acceleration.z == 9.81
    assert message.linear_acceleration_covariance[0] * unit_mps2**2 == pytest.approx(1e-6 * 200)
    assert message.angular_velocity.z == 0.3
    frames = [t.child_frame_id for t in by_topic["/tf_static"].transforms]
    assert sorted(frames) == sorted(["inner", frame])


def topics_of(profile: str, *sensors: SensorConfig) -> dict[str, set[str]]:
    """Topics of each stream of a rig under a profile."""
    made = profile_for(profile, sensors)
    streams = [f"{s.name}{end}" for s in sensors for end in ("", "_semantic") if s.kind == "lidar" or not end]
    kinds = {"lidar": PointCloud, "imu": Imu}
    kind_of = {s.name: kinds[s.kind] for s in sensors}
    return {
        stream: {
            route.topic for route in made.routes(kind_of[stream.removesuffix("_semantic")], stream, streams)
        }
        for stream in streams
    }


def test_topics_of_the_profiles() -> None:
    """The driver's cloud stands beside ours; a LiDAR of any name has a cloud for SLAM systems."""
    plain, ouster = LidarConfig(name="roof"), replace(lidar("ouster"), name="front")
    assert topics_of("slam", plain) == {"roof": {"/roof/points"}, "roof_semantic": set()}
    assert topics_of("slam", ouster)["front"] == {"/front/points", "/ouster/points"}
    assert topics_of("standard", ouster) == {
        "front": {"/ouster/points"},
        "front_semantic": {"/front/points"},
    }
    for profile in ("paper", "compact"):
        assert "/ouster/points" not in topics_of(profile, ouster)["front"]
    labelled = replace(ouster, outputs=("semantic",))
    routes = profile_for("slam", [labelled]).routes(PointCloud, "front_semantic", ["front_semantic"])
    assert [(r.topic, r.message) for r in routes] == [
        ("/front/points", "points"),
        ("/ouster/points", "points_ouster"),
    ]


def test_equal_topics_and_frames_get_names() -> None:
    """Two LiDARs of a maker; a LiDAR whose own topic is its driver's; a frame that is another sensor's."""
    first, second = (replace(lidar("velodyne"), name=name) for name in ("left", "right"))
    topics = topics_of("slam", first, second)
    assert topics["left"] == {"/left/points", "/left/velodyne_points"}
    assert topics["right"] == {"/right/points", "/right/velodyne_points"}
    assert set(driver_frames([first, second])) == {"left/velodyne", "right/velodyne"}
    named = replace(lidar("ouster"), name="ouster")
    assert topics_of("standard", named) == {
        "ouster": {"/ouster/points"},
        "ouster_semantic": {"/ouster_semantic/ouster/points"},
    }
    other = LidarConfig(name="velodyne", mount=Mount(position_m=(0.0, 0.0, 2.0)))
    assert set(driver_frames([other, first])) == {"left/velodyne"}
    # A Livox and the IMU inside have one frame, that of the LiDAR.
    sensors = [lidar("livox"), ImuConfig(layout="livox")]
    assert driver_frames(sensors)["livox_frame"][:3, 3].tolist() == [1.0, 0.0, 1.8]
    assert topics_of("slam", *sensors)["imu"] == {"/imu/data", "/livox/imu"}


def test_settings_that_are_refused() -> None:
    with pytest.raises(ConfigError, match="layout"):
        LidarConfig(layout="sick")
    with pytest.raises(ConfigError, match="time_unit is us; give s, or us with layout velodyne"):
        replace(lidar("ouster"), time_unit="us")
    with pytest.raises(ConfigError, match="sectors give many columns one time"):
        LidarConfig(layout="ouster", sectors=10)
    with pytest.raises(ConfigError, match="layout"):
        ImuConfig(layout="velodyne")
    text = "name: x\nsensors:\n- {kind: imu, layout: livox}\n- {kind: lidar, preset: vlp16, time_unit: us}"
    assert SensorRig.from_yaml(text).of_kind("imu")[0].layout == "livox"
