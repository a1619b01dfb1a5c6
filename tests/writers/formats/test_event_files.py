"""Events in DSEC's layout and as dvs_msgs, against what independent readers find."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores
from shared_fixtures.readings.bag_samples import batch_of, write_all

from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.samples import EVENT, Events
from carlaloc_env.sensors.camera_config import CameraConfig
from recorder.replaying.options import without_unwritten
from recorder.writers.base import DEFAULT_EPOCH_NS
from recorder.writers.formats.dsec import DsecEncoder, DsecWriter
from recorder.writers.rig_calibration import RigCalibration
from recorder.writers.ros.event_messages import cdr_with_events
from recorder.writers.ros.message_parts import make_typestore
from recorder.writers.ros.messages import MessageMaker
from recorder.writers.ros.rosbag1 import Ros1Encoder, Rosbag1Writer

PERIOD_NS = 50_000_000


def batch(number: int, count: int) -> Events:
    generator = np.random.default_rng(number)
    events = np.zeros(count, EVENT)
    begin = (number - 1) * PERIOD_NS
    events["t"] = begin + 1000 * np.sort(generator.integers(1, 50_001, count))
    events["x"], events["y"] = generator.integers(0, 1280, count), generator.integers(0, 720, count)
    events["p"] = generator.integers(0, 2, count)
    return batch_of(events, number * PERIOD_NS)


BATCHES = [batch(0, 0), batch(1, 5000), batch(2, 0), batch(3, 3001), batch(4, 17)]
ALL = np.concatenate([one.events for one in BATCHES])


def write(folder: Path, compression: str = "gzip") -> Path:
    path = folder / "events_left.h5"
    return write_all(DsecWriter(path, DsecEncoder("events_left"), compression=compression), BATCHES)


@pytest.mark.parametrize("compression", ["gzip", "lzf"])
def test_dsec_file_holds_every_event(tmp_path: Path, compression: str) -> None:
    with h5py.File(write(tmp_path, compression)) as file:
        events = file["events"]
        kinds = {name: events[name].dtype.str for name in events}
        assert kinds == {"p": "|u1", "t": "<u4", "x": "<u2", "y": "<u2"}
        t_ns = (events["t"][:].astype(np.int64) + file["t_offset"][()]) * 1000 - DEFAULT_EPOCH_NS
        np.testing.assert_array_equal(t_ns, ALL["t"])
        for name in "xyp":
            np.testing.assert_array_equal(events[name][:], ALL[name])


def test_dsec_milliseconds_point_at_their_first_event(tmp_path: Path) -> None:
    """The definition of the format, for every millisecond."""
    with h5py.File(write(tmp_path)) as file:
        t, index = file["events/t"][:], file["ms_to_idx"][:]
    assert len(index) == 201
    for ms, first in enumerate(index):
        assert np.all(t[:first] < 1000 * ms)
        assert np.all(t[first:] >= 1000 * ms)


def test_bag_holds_dvs_msgs_event_arrays(tmp_path: Path) -> None:
    writer = Rosbag1Writer(tmp_path / "e.bag", Ros1Encoder(RigCalibration(), profile="full"))
    path = write_all(writer, BATCHES)
    with AnyReader([path]) as reader:
        (connection,) = (c for c in reader.connections if c.topic == "/camera/left/events")
        assert connection.msgtype == "dvs_msgs/msg/EventArray"
        assert connection.digest == "5e8beee5a6c107e504c2e78903c224b8"
        messages = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages([connection])]
    assert [len(m.events) for m in messages] == [len(one.events) for one in BATCHES]  # type: ignore[attr-defined]
    for message, one in zip(messages, BATCHES, strict=True):
        read: Any = message
        assert (read.width, read.height, read.header.frame_id) == (1280, 720, "camera_left")
        for event, row in list(zip(read.events, one.events, strict=True))[::97]:
            unix_ns = event.ts.sec * 10**9 + event.ts.nanosec
            assert (unix_ns - DEFAULT_EPOCH_NS, event.x, event.y, event.polarity) == tuple(row)


@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_packed_cdr_is_what_a_serialiser_writes(count: int) -> None:
    typestore = make_typestore(Stores.ROS2_HUMBLE)
    maker = MessageMaker(typestore, epoch_ns=DEFAULT_EPOCH_NS, pinholes={})
    sample = batch(3, count)
    empty = maker.make("event_array", sample, "/camera/left/events")
    rows = [
        maker.new("dvs_msgs/Event", x=int(x), y=int(y), ts=maker.time(int(t)), polarity=bool(p))
        for t, x, y, p in sample.events
    ]
    full = maker.new("dvs_msgs/EventArray", header=empty.header, height=720, width=1280, events=rows)
    kind = "dvs_msgs/msg/EventArray"
    packed = cdr_with_events(bytes(typestore.serialize_cdr(empty, kind)), sample, DEFAULT_EPOCH_NS)
    assert packed == bytes(typestore.serialize_cdr(full, kind))


@pytest.mark.parametrize(
    ("formats", "topics", "kept"),
    [
        (("rosbag1",), "full", True),
        (("rosbag1",), "standard", False),
        (("euroc",), "standard", False),
        (("euroc", "dsec"), "slam", True),
        (("rosbag1",), "paper", False),
    ],
)
def test_events_are_made_only_for_formats_that_hold_them(
    formats: tuple[str, ...], topics: str, kept: bool
) -> None:
    rig = without_unwritten(rig_by_name("paper"), formats, topics)
    cameras = [config for config in rig.sensors if isinstance(config, CameraConfig)]
    assert [("events" in camera.outputs) for camera in cameras] == [kept, kept]
    assert all(camera.outputs[:3] == ("rgb", "depth", "semantic") for camera in cameras)
    assert len(rig.sensors) == len(rig_by_name("paper").sensors)
