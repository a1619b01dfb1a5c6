"""Messages beyond camera, LiDAR, IMU and GNSS: official definitions, values and units, ROS 1 and ROS 2."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores
from shared_fixtures.readings.bag_samples import imu, truth, two_objects
from shared_fixtures.readings.imu_readings import QUIET, rows

from carlaloc_env.samples import DepthImage, GnssFix, RadarScan, Sample, SemanticImage, WheelTicks
from carlaloc_env.sensors.imu import ImuConfig
from recorder.writers.rig_calibration import RigCalibration
from recorder.writers.ros.compact_messages import depth_of_png
from recorder.writers.ros.message_parts import make_typestore
from recorder.writers.ros.messages import ENCODERS, MessageMaker
from recorder.writers.ros.rosbag1 import Ros1Encoder
from recorder.writers.topic_profiles import PROFILES, STANDARD

OFFICIAL_MD5 = {
    "radar_msgs/msg/RadarScan": "6dfacef1e665538dbd8e159d5ce7a97a",
    "sensor_msgs/msg/JointState": "3066dcd76a6cfaef579bd0f34173e9fd",
}
STORES = (Stores.ROS1_NOETIC, Stores.ROS2_HUMBLE)
POINT_TYPES = {2: "<u1", 4: "<u2", 5: "<i4", 6: "<u4", 7: "<f4", 8: "<f8"}


def round_trip(store: Stores, encoder: str, sample: Sample) -> Any:
    """The message of a sample after serialising and reading it again."""
    typestore = make_typestore(store)
    maker = MessageMaker(typestore, epoch_ns=10**18, pinholes={})
    name = ENCODERS[encoder][0]
    message = maker.make(encoder, sample, "/x")
    if store is Stores.ROS1_NOETIC:
        return typestore.deserialize_ros1(typestore.serialize_ros1(message, name), name)
    return typestore.deserialize_cdr(typestore.serialize_cdr(message, name), name)


def table(message: Any) -> np.ndarray[Any, np.dtype[np.void]]:
    """Rows of a PointCloud2."""
    fields = message.fields
    layout: Any = {
        "names": [f.name for f in fields], "formats": [POINT_TYPES[f.datatype] for f in fields],
        "offsets": [f.offset for f in fields], "itemsize": message.point_step,
    }  # fmt: skip
    rows: np.ndarray[Any, np.dtype[np.void]] = np.frombuffer(message.data.tobytes(), dtype=np.dtype(layout))
    assert len(rows) == message.width * message.height
    return rows


def scan() -> RadarScan:
    """Two detections: 30° to the left and level; ahead and 30° up."""
    readings: dict[str, Any] = {
        "range_m": [10, 20], "azimuth_rad": np.radians([30, 0]), "elevation_rad": np.radians([0, 30]),
        "doppler_mps": [-5.0, 2.5], "snr_db": [20, 13], "rcs_dbsm": [3, -8],
    }  # fmt: skip
    numbers = {name: np.array(row, np.float32) for name, row in readings.items()}
    return RadarScan(
        sensor="radar_left", frame_id="radar_left", stamp_ns=50_000_000, tag=np.array([14, 0], np.uint8),
        instance=np.array([2**23 + 5, 0], np.uint32), origin=np.array([0, 2], np.uint8), **numbers,
    )  # fmt: skip


def test_definitions_are_the_official_ones() -> None:
    """MD5 sums of the ROS 1 definitions."""
    typestore = make_typestore()
    for name, md5 in OFFICIAL_MD5.items():
        assert typestore.generate_msgdef(name)[1] == md5


@pytest.mark.parametrize("store", STORES, ids=str)
def test_radar_messages(store: Stores) -> None:
    rows = table(round_trip(store, "radar_points", scan()))
    place = np.stack([rows[axis] for axis in "xyz"], axis=-1)
    assert place == pytest.approx(
        np.array([[10 * np.sqrt(0.75), 5.0, 0.0], [20 * np.sqrt(0.75), 0.0, 10.0]]), abs=1e-5
    )
    assert rows["doppler"].tolist() == [-5.0, 2.5]
    assert rows["id"].tolist() == [2**23 + 5, 0]
    assert rows["origin"].tolist() == [0, 2]
    message = round_trip(store, "radar_scan", scan())
    assert [r.doppler_velocity for r in message.returns] == [-5.0, 2.5]
    assert [r.amplitude for r in message.returns] == [20.0, 13.0]
    assert message.returns[0].azimuth == pytest.approx(np.radians(30.0), abs=1e-6)
    assert message.header.frame_id == "radar_left"


def test_topics_of_radar() -> None:
    topics = [route.topic for route in STANDARD.routes(RadarScan, "radar_left")]
    assert topics == ["/radar/left/points", "/radar/left/scan"]


@pytest.mark.parametrize("store", STORES, ids=str)
def test_wheels_are_joints(store: Stores) -> None:
    """Angles of whole ticks in radians, names in the order of the wheels."""
    sample = WheelTicks(
        sensor="wheels", frame_id="wheels", stamp_ns=0, ticks=np.array([96, 48, -24, 0]),
        rate_radps=np.array([1.0, 2.0, 3.0, 4.0]), ticks_per_turn=96,
    )  # fmt: skip
    message = round_trip(store, "wheel_joints", sample)
    assert message.name[0] == "wheel_front_left"
    assert message.position == pytest.approx(np.pi * np.array([2.0, 1.0, -0.5, 0.0]))
    assert message.velocity.tolist() == [1.0, 2.0, 3.0, 4.0]


@pytest.mark.parametrize("store", STORES, ids=str)
def test_imu_orientation_is_marked(store: Stores) -> None:
    """No estimate: covariance[0] = −1; an attitude comes with its variance."""
    assert round_trip(store, "imu", imu()).orientation_covariance[0] == -1.0
    full = replace(imu(), quat_xyzw=np.array([0.0, 0.6, 0.0, 0.8]), orientation_noise_rad=0.1)
    message = round_trip(store, "imu", full)
    assert message.orientation_covariance == pytest.approx(np.eye(3).reshape(-1) * 0.01)
    assert (message.orientation.y, message.orientation.w) == (0.6, 0.8)


def test_imu_covariances_are_those_of_the_noise(scenery: Any) -> None:
    """The variance of readings at rest, which 20 s give to 1.8 % (1σ) at 100 Hz."""
    second = {"name": "second", "rate_hz": 100.0, "accel_noise_density": 5e-3, "gyro_noise_density": 1e-3}
    densities = {"accel_noise_density": 2e-3, "gyro_noise_density": 2e-4}
    configs = [ImuConfig(**{**QUIET, **densities}), ImuConfig(**{**QUIET, **second})]
    encoder = Ros1Encoder(RigCalibration.from_configs(configs))
    for config in configs:
        sensor = config.build(scenery.world())
        stamps = sensor.schedule.stamps_ns_in(0, 20 * 10**9)
        samples = sensor.measure(scenery.drive(scenery.straight(), 20.0), stamps)
        (piece,) = encoder.encode(samples[0])
        message = encoder.deserialise(piece.data, piece.kind)
        variances = rows(samples).var(axis=0).reshape(2, 3).mean(axis=1)
        for name, variance in zip(("linear_acceleration", "angular_velocity"), variances, strict=True):
            covariance = getattr(message, f"{name}_covariance").reshape(3, 3)
            assert covariance == pytest.approx(variance * np.eye(3), rel=0.06)


@pytest.mark.parametrize("store", STORES, ids=str)
def test_depth_tells_the_sky_from_nothing(store: Stores) -> None:
    """REP 117: +Inf beyond the range, NaN where nothing is measured; both are 0 as integers (REP 118)."""
    depth_m = np.array([[0.0, 5.0, np.nan]], np.float32)
    picture = DepthImage(sensor="depth_left", frame_id="camera_left", stamp_ns=0, depth_m=depth_m)
    plain = round_trip(store, "image_32fc1", picture).data.view("<f4")
    np.testing.assert_array_equal(plain, [np.inf, 5.0, np.nan])
    compact = depth_of_png(round_trip(store, "depth_png", picture).data.tobytes())
    np.testing.assert_allclose(compact, [[0.0, 5.0, 0.0]], atol=4e-4)


@pytest.mark.parametrize(
    ("solution", "status", "kind"), [("none", -1, 0), ("single", 0, 3), ("float", 2, 3), ("fixed", 2, 3)]
)
def test_gnss_status(solution: str, status: int, kind: int) -> None:
    """NavSatStatus: −1 no fix, 0 fix, 2 augmented from the ground; covariance unknown without a fix."""
    fix = GnssFix(
        sensor="gnss", frame_id="gnss", stamp_ns=0, latitude_deg=49.0, longitude_deg=8.0, altitude_m=100.0,
        covariance_enu_m2=np.array([[4.0, 1.0, 0.0], [1.0, 4.0, 0.0], [0.0, 0.0, 9.0]]),
        has_fix=solution != "none", solution=solution, satellites=9,
    )  # fmt: skip
    message = round_trip(Stores.ROS1_NOETIC, "nav_sat_fix", fix)
    assert message.status.status == status
    assert message.position_covariance_type == kind


@pytest.mark.parametrize("store", STORES, ids=str)
def test_objects_as_carlas_bridge_writes_them(store: Stores) -> None:
    """Box, class and world-frame velocity; the table adds what the message has no field for."""
    message = round_trip(store, "objects", two_objects())
    car, walker = message.objects
    assert (car.id, car.classification, walker.classification) == (2**23 + 1, 6, 4)
    assert car.shape.type == 1
    assert car.shape.dimensions.tolist() == [4.5, 1.8, 1.4]
    assert car.pose.orientation.z == pytest.approx(np.sin(np.pi / 4))
    assert (car.twist.linear.y, car.twist.angular.z) == (9.0, 0.1)
    message = round_trip(store, "object_table", two_objects())
    rows = {channel.name: channel.values for channel in message.channels}
    assert [(point.x, point.y) for point in message.points] == [(1.0, 2.0), (5.0, 6.0)]
    assert rows["length"] == pytest.approx([4.5, 0.6])
    assert rows["id"].tolist() == [2**23 + 1, 2**23 + 2]
    assert rows["visible"][0] == 0.5
    assert np.isnan(rows["visible"][1])
    assert rows["vy"][0] == 9.0
    assert rows["label"].tolist() == [14, 12]


@pytest.mark.parametrize("store", STORES, ids=str)
def test_acceleration_is_in_the_frames_own_axes(store: Stores) -> None:
    """Facing north, an acceleration to the north is ahead."""
    north = (0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))
    motion = truth(0, (0, 0, 0), north, acceleration_world_mps2=np.array([0.0, 2.0, 0.0]))
    linear = round_trip(store, "acceleration", motion).accel.linear
    assert (linear.x, linear.y, linear.z) == pytest.approx((2.0, 0.0, 0.0), abs=1e-12)


def test_instance_pictures_hold_the_ids_of_the_boxes() -> None:
    instance = np.array([[0, 7], [2**23 + 1, 2**23 + 2]], np.uint32)
    tags = np.zeros((2, 2), np.uint8)
    picture = SemanticImage(
        sensor="semantic_left", frame_id="camera_left", stamp_ns=0, tag=tags, instance=instance
    )  # fmt: skip
    message = round_trip(Stores.ROS1_NOETIC, "image_instances", picture)
    assert message.encoding == "32SC1"
    assert np.array_equal(message.data.view("<i4").reshape(2, 2), instance)
    routes = {name: PROFILES[name].routes(SemanticImage, "semantic_left") for name in ("full", "standard")}
    assert [route.topic for route in routes["full"]] == ["/camera/left/semantic", "/camera/left/instance"]
    assert [route.topic for route in routes["standard"]] == ["/camera/left/semantic"]
