"""Fields of point clouds by their own datatype, offset, count and byte order, and which topic is read."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from shared_fixtures.readings import dressed_clouds as clouds
from shared_fixtures.readings.dressed_clouds import TOPIC, Dressing, dressed, message_of
from shared_fixtures.readings.slam_dataset import sweep

from carlaloc_env.core.errors import EvaluationError
from recorder.dataset.clouds import cloud_of_fields
from recorder.dataset.scans import read_scans

STORE = get_typestore(Stores.ROS1_NOETIC)
ROWS = np.array(
    [
        (1.5, -2.0, 3.0, 31),
        (0.0, 0.0, 0.0, 30),
        (np.nan, 1.0, 1.0, 29),
        (4.0, 5.0, np.inf, 28),
        (7, 8, 9, 27),
    ],
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("ring", "u1")],
)


@pytest.mark.parametrize("code", ["i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"])
@pytest.mark.parametrize("order", ["<", ">"])
def test_every_datatype_and_byte_order_is_read(code: str, order: str) -> None:
    names = ("pad", "ring", "z", "y", "x", "intensity")
    rows = np.zeros(6, [(name, "V3" if name == "pad" else order + code) for name in names])
    values = {"x": np.arange(1, 7), "y": np.arange(2, 8), "z": np.arange(3, 9), "ring": np.arange(6)}
    for name, column in values.items():
        rows[name] = column
    for height in (1, 2, 3):
        message = message_of(STORE, rows, 5, Dressing(order=order, height=height, row_pad=5 * (height - 1)))
        cloud = cloud_of_fields(message)
        np.testing.assert_array_equal(cloud.points_xyz_m, np.stack([values[n] for n in "xyz"], axis=1))
        assert cloud.ring is not None
        assert cloud.ring.tolist() == [0, 1, 2, 3, 4, 5]
        assert cloud.stamp_ns == 5


def test_rays_without_return_are_left_out() -> None:
    cloud = cloud_of_fields(message_of(STORE, ROWS, 0, Dressing()))
    assert cloud.points_xyz_m.tolist() == [[1.5, -2.0, 3.0], [7.0, 8.0, 9.0]]
    assert cloud.ring is not None
    assert cloud.ring.tolist() == [31, 27]


def test_a_ring_of_one_byte_is_read_without_its_neighbour() -> None:
    dressing = Dressing(ring=("ring", "u1"), time=("reflectivity", "u1"), unit_ns=10**9)
    ring = cloud_of_fields(dressed(STORE, 0, dressing)).ring
    np.testing.assert_array_equal(ring, sweep(0).ring)


def test_labels_of_another_vocabulary_are_no_tags() -> None:
    rows = np.zeros(3, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("label", "<u4")])
    rows["x"], rows["label"] = 1.0, [14, 0, 255]
    cloud = cloud_of_fields(message_of(STORE, rows, 0, Dressing()))
    assert cloud.tag is not None
    assert cloud.tag.tolist() == [14, 0, 255]
    rows["label"][0] = 256
    assert cloud_of_fields(message_of(STORE, rows, 0, Dressing())).tag is None


@pytest.mark.parametrize(("at_m", "kept_m"), [(0.1, float(np.float32(0.1))), (5_336_000.1, 5_336_000.1)])
def test_double_coordinates_are_those_of_single_ones_but_far_away(at_m: float, kept_m: float) -> None:
    rows = np.full(2, at_m, [(axis, "<f8") for axis in "xyz"])
    cloud = cloud_of_fields(message_of(STORE, rows, 0, Dressing()))
    assert cloud.points_xyz_m.tolist() == [[kept_m] * 3] * 2


@pytest.mark.parametrize("row_step", [0, 13, 10**6])
def test_a_stale_row_step_of_dense_rows_is_seen_through(row_step: int) -> None:
    message = message_of(STORE, ROWS[[0, 4, 0, 4]], 0, Dressing(height=2))
    cloud = cloud_of_fields(replace(message, row_step=row_step))
    assert cloud.points_xyz_m[:, 0].tolist() == [1.5, 7.0, 1.5, 7.0]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"point_step": 12}, "field ring has datatype 2 at byte 12 of 12"),
        ({"width": 500}, "has 65 bytes"),
        ({"height": 9}, "has 65 bytes"),
        ({"fields": []}, "no field x, y, z; it has none at all"),
    ],
)
def test_a_cloud_that_contradicts_itself_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(EvaluationError, match=words):
        cloud_of_fields(replace(message_of(STORE, ROWS, 0, Dressing()), **changes))


@pytest.mark.parametrize(("key", "value"), [("datatype", 0), ("datatype", 9), ("offset", 2**32 - 1)])
def test_a_field_that_cannot_be_is_named(key: str, value: int) -> None:
    message = message_of(STORE, ROWS, 0, Dressing())
    setattr(message.fields[1], key, value)
    with pytest.raises(EvaluationError, match="field y has datatype"):
        cloud_of_fields(message)


def test_an_empty_cloud_has_no_points() -> None:
    message = replace(message_of(STORE, ROWS, 0, Dressing()), width=0, row_step=0, data=np.zeros(0, np.uint8))
    assert cloud_of_fields(message).points_xyz_m.shape == (0, 3)


def bag(path: Path, *topics: str) -> Path:
    found = [dressed(STORE, k, Dressing()) for k in range(2)]
    return clouds.write_ros1(path / "run.bag", STORE, dict.fromkeys(topics, found))


def test_the_only_topic_with_clouds_is_read(tmp_path: Path) -> None:
    assert len(list(read_scans(bag(tmp_path, "/os1/points")))) == 2
    assert len(list(read_scans(bag(tmp_path / "..", TOPIC, "/radar/points")))) == 2


def test_several_topics_are_named(tmp_path: Path) -> None:
    path = bag(tmp_path, "/front", "/rear")
    with pytest.raises(EvaluationError, match="several topics with clouds; choose by --topic: /front, /rear"):
        list(read_scans(path))
    with pytest.raises(EvaluationError, match="no topic with point clouds '/fron'; did you mean '/front'"):
        list(read_scans(path, "/fron"))


@pytest.mark.parametrize("topic", [None, "/velodyne_packets"])
def test_clouds_of_other_messages_are_named(tmp_path: Path, topic: str | None) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    kind = "velodyne_msgs/msg/VelodyneScan"
    store.register(get_types_from_msg("std_msgs/Header header\nuint8[] packets\n", kind))
    message = store.types[kind](header=clouds._header(store, 0), packets=np.zeros(9, np.uint8))
    path = clouds.write_ros1(tmp_path / "raw.bag", store, {"/velodyne_packets": [message]})
    with pytest.raises(EvaluationError, match=r"PointCloud2 .*; /velodyne_packets is velodyne_msgs/msg/Velo"):
        list(read_scans(path, topic))


def test_livox_points_of_another_layout_are_refused(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    point = "livox_ros_driver/msg/CustomPoint"
    store.register(get_types_from_msg("float64 x\nfloat64 y\nfloat64 z\n", point))
    kind = "livox_ros_driver/msg/CustomMsg"
    store.register(
        get_types_from_msg("std_msgs/Header header\nlivox_ros_driver/CustomPoint[] points\n", kind)
    )
    message = store.types[kind](header=clouds._header(store, 0), points=[])
    with pytest.raises(EvaluationError, match="points of x, y, z, which are not the driver's"):
        list(read_scans(clouds.write_ros1(tmp_path / "a.bag", store, {TOPIC: [message]})))


def rows_of(fields: str, points: Any, **columns: float) -> Any:
    """Rows of single-precision fields, of which x, y, z are given."""
    rows = np.zeros(len(points), [(name, "<f4") for name in fields.split()])
    for name, values in {**dict(zip("xyz", np.transpose(points), strict=True)), **columns}.items():
        rows[name] = values
    return rows


def at(number: int, rows: Any, frame: str = "lidar", period_ns: int = clouds.SWEEP_NS) -> Any:
    message = message_of(STORE, rows, clouds.DEFAULT_EPOCH_NS + number * period_ns, Dressing())
    return replace(message, header=replace(message.header, frame_id=frame))


SOME = np.random.default_rng(3).uniform(-20, 20, (3000, 3))
GRID = np.stack(np.meshgrid(np.arange(60) * 0.1, np.arange(60) * 0.1, np.arange(3) * 0.1), axis=-1)
AHEAD = np.array([4.0, 0.0, 0.0])
LEFT, RIGHT = SOME + AHEAD, SOME - AHEAD
ODD: dict[str, tuple[Any, str]] = {
    "registered": (
        lambda k: at(k, rows_of("x y z", SOME), "/robot/odom"),
        "'robot/odom' moves with no",
    ),
    "boxes": (lambda k: at(k, rows_of("x y z length width heading", SOME)), "boxes of objects"),
    "radar": (lambda k: at(k, rows_of("x y z velocity", SOME[:300])), r"a radar \(velocity, 300 points\)"),
    "few": (lambda k: at(k, rows_of("x y z", SOME[:40])), "have 40 points"),
    "costs": (lambda k: at(k, rows_of("x y z total_cost", SOME)), r"costs \(total_cost\)"),
    "plane": (lambda k: at(k, rows_of("x y z", SOME * [1, 1, 0])), "one plane"),
    "grid": (lambda k: at(k, rows_of("x y z", GRID.reshape(-1, 3) + 0.05)), "cells of a grid"),
    "camera": (lambda k: at(k, rows_of("x y z rgb", SOME)), "camera's coloured points"),
    "far": (lambda k: at(k, rows_of("x y z", SOME + 1e6 * AHEAD)), "4000 km away"),
    "near": (lambda k: at(k, rows_of("x y z", SOME / 100)), "within 0.4 m"),
    "seldom": (lambda k: at(k, rows_of("x y z", SOME), period_ns=5 * 10**9), "a cloud every 5.0 s"),
    "by turns": (lambda k: at(k, rows_of("x y z", RIGHT if k % 2 else LEFT)), "two sensors of one frame"),
    "at once": (lambda k: at(k // 2, rows_of("x y z", SOME)), "two sensors of one frame"),
}
"""Clouds of other things than one LiDAR, and the words that name them."""


@pytest.mark.parametrize("kind", ODD)
def test_a_topic_is_a_lidars_only_if_its_clouds_look_like_sweeps(
    tmp_path: Path, kind: str, caplog: pytest.LogCaptureFixture
) -> None:
    make, words = ODD[kind]
    odd, sweeps = [make(k) for k in range(12)], [dressed(STORE, k, Dressing()) for k in range(3)]
    alone = clouds.write_ros1(tmp_path / "alone.bag", STORE, {"/odd": odd})
    with pytest.raises(EvaluationError, match=f"--topic takes one even so .*{words}"):
        list(read_scans(alone))
    assert len(list(read_scans(alone, "/odd"))) == 12
    assert "/odd is read as asked for, but" in caplog.text
    both = clouds.write_ros1(tmp_path / "both.bag", STORE, {"/odd": odd, "/os1/points": sweeps})
    assert len(list(read_scans(both))) == 3
    assert "/os1/points is read, --topic names another (/odd: " in caplog.text


def test_of_two_sensors_on_a_topic_one_is_chosen_by_its_frame(tmp_path: Path) -> None:
    made = [at(k, rows_of("x y z", RIGHT if k % 2 else LEFT), "right" if k % 2 else "left") for k in range(8)]
    path = clouds.write_ros1(tmp_path / "a.bag", STORE, {"/points": made})
    for topic in (None, "/points"):
        with pytest.raises(EvaluationError, match="--topic /points:left or /points:right"):
            list(read_scans(path, topic))
    found = [scan.points_xyz_m[:, 0].mean() for _, scan in read_scans(path, "/points:right")]
    assert found == pytest.approx([RIGHT[:, 0].mean()] * 4, abs=1e-3)


def test_clouds_that_cannot_be_unpacked_are_named_with_the_tool(tmp_path: Path) -> None:
    """Beside a radar, which must not take their place."""
    store = get_typestore(Stores.ROS1_NOETIC)
    kind = "point_cloud_interfaces/msg/CompressedPointCloud2"
    store.register(get_types_from_msg("std_msgs/Header header\nuint8[] data\nstring format\n", kind))
    packed = [
        store.types[kind](header=at(k, ROWS).header, data=np.zeros(9, np.uint8), format="cloudini/lossy/zstd")
        for k in range(3)
    ]
    radar = [at(k, rows_of("x y z rcs", SOME[:50])) for k in range(3)]
    path = clouds.write_ros1(tmp_path / "a.bag", store, {"/packed": packed, "/radar": radar})
    with pytest.raises(EvaluationError, match=r"by cloudini/lossy/zstd; .*_rosbag_converter; /radar: "):
        list(read_scans(path))
    with pytest.raises(EvaluationError, match="cloudini_rosbag_converter"):
        list(read_scans(path, "/packed"))
