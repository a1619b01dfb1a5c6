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
