"""Messages beyond camera, LiDAR, IMU and GNSS: official definitions, values and units, ROS 1 and ROS 2."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores

from carlaloc_env.samples import RadarScan, Sample
from recorder.writers.messages import ENCODERS, MessageMaker, make_typestore
from recorder.writers.topics import STANDARD

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
    dtype = np.dtype(
        {
            "names": [f.name for f in message.fields],
            "formats": [POINT_TYPES[f.datatype] for f in message.fields],
            "offsets": [f.offset for f in message.fields],
            "itemsize": message.point_step,
        }
    )
    rows: np.ndarray[Any, np.dtype[np.void]] = np.frombuffer(message.data.tobytes(), dtype=dtype)
    assert len(rows) == message.width * message.height
    return rows


def scan() -> RadarScan:
    """Two detections: 30° to the left and level; ahead and 30° up."""
    return RadarScan(
        sensor="radar_left",
        frame_id="radar_left",
        stamp_ns=50_000_000,
        range_m=np.array([10.0, 20.0], np.float32),
        azimuth_rad=np.radians([30.0, 0.0]).astype(np.float32),
        elevation_rad=np.radians([0.0, 30.0]).astype(np.float32),
        doppler_mps=np.array([-5.0, 2.5], np.float32),
        snr_db=np.array([20.0, 13.0], np.float32),
        rcs_dbsm=np.array([3.0, -8.0], np.float32),
        tag=np.array([14, 0], np.uint8),
        instance=np.array([2**23 + 5, 0], np.uint32),
        origin=np.array([0, 2], np.uint8),
    )


def test_definitions_are_the_official_ones() -> None:
    """MD5 sums of the ROS 1 definitions."""
    typestore = make_typestore()
    for name, md5 in {"radar_msgs/msg/RadarScan": "6dfacef1e665538dbd8e159d5ce7a97a"}.items():
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
