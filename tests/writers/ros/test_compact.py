"""Bags of the profiles `compact`, read by software that nobody here wrote: what is lost is what is told."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from shared_fixtures.readings.bag_samples import cloud_of, read, two_objects, write_all

from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import DepthImage, Image, PointCloud, Sample, SemanticImage
from carlaloc_env.sensors.base import Mount
from recorder.bags.reader import open_bag
from recorder.dataset.scans import read_scans
from recorder.writers.base import DEFAULT_EPOCH_NS, Writer
from recorder.writers.rig_calibration import CameraCalibration, RigCalibration
from recorder.writers.ros import compact_messages
from recorder.writers.ros.compact_messages import DRACO_FIELDS, depth_of_png
from recorder.writers.ros.rosbag1 import Ros1Encoder, Rosbag1Writer
from recorder.writers.ros.rosbag2 import METADATA, Ros2Encoder, Rosbag2Writer

av = pytest.importorskip("av")
draco = pytest.importorskip("DracoPy", reason="clouds of the profile compact need DracoPy")

WIDTH, HEIGHT, PICTURES = 320, 192, 45
PINHOLE = Pinhole.from_fov(WIDTH, HEIGHT, 90.0)
RIG = RigCalibration.of(
    cameras=[
        CameraCalibration(name="left", T_base_camera=Mount(axes="optical").T_base_sensor, pinhole=PINHOLE)
    ]
)


def picture(number: int) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """A grey texture in slowly changing colours, which moves to the left by two pixels a picture."""
    rng = np.random.default_rng(5)
    grey = cv2.resize(rng.integers(40, 216, (24, 80), dtype=np.uint8), (4 * WIDTH, HEIGHT))
    tint = cv2.resize(rng.integers(-40, 41, (3, 8, 3)).astype(np.float32), (4 * WIDTH, HEIGHT))
    wide = np.clip(grey[..., None] + tint, 0, 255).astype(np.uint8)
    return np.ascontiguousarray(wide[:, 2 * number : 2 * number + WIDTH])


def depth() -> np.ndarray[Any, np.dtype[np.float32]]:
    """0 for the sky, then from half a metre to 900 m."""
    values = np.geomspace(0.5, 900.0, WIDTH * HEIGHT).astype(np.float32).reshape(HEIGHT, WIDTH)
    values[:10] = 0.0
    return values


def cloud(stamp_ns: int, count: int = 20_000) -> PointCloud:
    """Columns of 32 rings, as a LiDAR gives them, on a wobbly wall 10 to 120 m away."""
    rng = np.random.default_rng(1)
    column, ring = np.divmod(np.arange(count), 32)
    azimuth, lift = 2 * np.pi * column / (count / 32), np.radians(-30 + 40 * ring / 31)
    distance = 65 + 55 * np.sin(7 * azimuth) + rng.normal(0, 0.02, count)
    unit = np.stack([np.cos(lift) * np.cos(azimuth), np.cos(lift) * np.sin(azimuth), np.sin(lift)], axis=1)
    return cloud_of(
        unit * distance[:, None], stamp_ns, intensity=rng.uniform(0, 255, count), ring=ring,
        offset_ns=column * 80_000, tag=ring % 29, instance=ring * 70_000,
    )  # fmt: skip


def drive() -> Iterator[Sample]:
    tags = np.random.default_rng(2).integers(0, 29, (HEIGHT, WIDTH), dtype=np.uint8)
    for number in range(PICTURES):
        stamp = number * 50_000_000
        at: dict[str, Any] = {"frame_id": "camera_left", "stamp_ns": stamp}
        yield Image(sensor="rgb_left", rgb=picture(number), **at)
        if number < 2:
            yield DepthImage(sensor="depth_left", depth_m=depth(), **at)
            yield SemanticImage(sensor="semantic_left", tag=tags, instance=tags.astype(np.uint32), **at)
            yield cloud(stamp)


@pytest.fixture(scope="module", params=["rosbag1", "rosbag2"])
def messages(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Messages of the same bag of either ROS, by topic."""
    folder = tmp_path_factory.mktemp("compact")
    streams = {sample.sensor for sample in drive()}
    writer: Writer = (
        Rosbag1Writer(folder / "a.bag", Ros1Encoder(RIG, profile="compact_full", streams=streams))
        if request.param == "rosbag1"
        else Rosbag2Writer(folder / "a", Ros2Encoder(RIG, profile="compact_full", streams=streams))
    )
    return read(write_all(writer, drive()))[1]


def test_each_message_of_the_video_is_one_picture(messages: Any) -> None:
    packets = [message for _, message in messages["/camera/left/video"]]
    assert len(packets) == PICTURES
    assert {(packet.format, packet.frame_id) for packet in packets} == {("h264", "camera_left")}
    decoder = av.CodecContext.create("h264", "r")
    errors = []
    for number, packet in enumerate(packets):
        (frame,) = decoder.decode(av.Packet(packet.data.tobytes()))
        assert frame.colorspace == 1, "the stream itself says BT.709"
        shown = frame.reformat(format="rgb24", src_colorspace="ITU709").to_ndarray()
        errors.append(np.mean((shown.astype(float) - picture(number)) ** 2))
    assert 10 * np.log10(255**2 / np.max(errors)) > 36.0


def test_video_can_be_entered_at_every_second(messages: Any) -> None:
    """Units of a keyframe: sequence and picture parameters (7, 8) stand before the picture (5)."""
    packets = [message.data.tobytes() for _, message in messages["/camera/left/video"]]
    kinds = [{part[0] & 31 for part in packet.split(b"\0\0\1")[1:]} for packet in packets]
    keys = [number for number, kind in enumerate(kinds) if 5 in kind]
    assert keys == [0, 20, 40]
    assert all({5, 7, 8} <= kinds[number] for number in keys)
    decoder = av.CodecContext.create("h264", "r")
    assert sum(len(decoder.decode(av.Packet(packet))) for packet in packets[20:]) == PICTURES - 20


def test_depth_is_inverse_depth_in_16_bits(messages: Any) -> None:
    message = messages["/camera/left/depth/compressedDepth"][0][1]
    assert message.format == "32FC1; compressedDepth png"
    found, true = depth_of_png(message.data.tobytes()), depth()
    assert np.array_equal(found == 0, true == 0)
    seen = true > 0
    # Half a step of the code: d² / (2 · 32 580 m), that is 1.5 mm at 10 m and 15 cm at 100 m.
    assert np.all(np.abs(found - true)[seen] <= 1.02 * true[seen] ** 2 / (2 * 180 * 181) + 1e-4)


def test_labels_lose_nothing(messages: Any) -> None:
    message = messages["/camera/left/semantic/compressed"][0][1]
    tags = cv2.imdecode(message.data, cv2.IMREAD_UNCHANGED)
    assert np.array_equal(tags, next(s.tag for s in drive() if isinstance(s, SemanticImage)))


def test_clouds_lose_less_than_a_centimetre(messages: Any) -> None:
    message = messages["/lidar/draco"][0][1]
    true = cloud(0)
    assert (message.format, message.frame_id, message.pose.orientation.w) == ("draco", "lidar", 1.0)
    found = draco.decode(message.data.tobytes())
    order = np.lexsort((true.offset_ns, true.ring))
    assert found.points.shape == true.points_xyz_m.shape
    assert np.abs(found.points - true.points_xyz_m[order]).max() < 0.0075 + 1e-4
    columns = {a["unique_id"]: a["data"].ravel() for a in found.attributes if a["attribute_type"] == 4}
    told = [columns[number] for number in sorted(columns)]
    assert len(told) == len(DRACO_FIELDS)
    assert np.abs(told[0] - true.intensity[order]).max() <= 0.5
    assert np.array_equal(told[1], true.ring[order])
    assert np.abs(told[2] * 1000.0 - true.offset_ns[order]).max() <= 500
    assert np.array_equal(told[3], true.tag[order])  # type: ignore[index]
    assert np.array_equal(told[4], true.instance[order])  # type: ignore[index]
    assert len(message.data) < 5.0 * len(order), "of 27 bytes a point"


def test_clouds_of_our_own_compact_bags_are_found_and_read(tmp_path: Path) -> None:
    """Beside the table of objects, which is no cloud for readers of ours or of others."""
    streams = {"lidar": 6, "objects": 6}
    writer = Rosbag2Writer(tmp_path / "a", Ros2Encoder(RIG, profile="compact", streams=streams))
    stamps = [number * 50_000_000 for number in range(6)]
    samples = [s for at in stamps for s in (replace(cloud(at), sensor="lidar"), two_objects(at))]
    path = write_all(writer, iter(samples))
    with open_bag(path) as reader:
        assert "sensor_msgs/msg/PointCloud2" not in {c.msgtype for c in reader.connections}
    found = [scan for _, scan in read_scans(path)]
    true = cloud(0)
    order = np.lexsort((true.offset_ns, true.ring))
    assert [scan.stamp_ns - DEFAULT_EPOCH_NS for scan in found] == stamps
    assert np.abs(found[0].points_xyz_m - true.points_xyz_m[order]).max() < 0.0075 + 1e-4
    assert found[0].time_s == pytest.approx(true.offset_ns[order] * 1e-9, abs=6e-7)
    assert np.array_equal(found[0].ring, true.ring[order])  # type: ignore[arg-type]
    assert np.array_equal(found[0].tag, true.tag[order])  # type: ignore[arg-type, index]


def test_kiss_icps_loader_finds_the_lidar_by_itself(tmp_path: Path) -> None:
    """It takes the only PointCloud2."""
    loaders = pytest.importorskip("kiss_icp.datasets.rosbag")
    streams = {"lidar", "objects"}
    writer = Rosbag1Writer(tmp_path / "a.bag", Ros1Encoder(RIG, profile="standard", streams=streams))
    path = write_all(writer, [replace(cloud(0, 640), sensor="lidar"), two_objects()])
    assert loaders.RosbagDataset(path, "").topic == "/lidar/points"


def test_without_draco_the_way_to_it_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "DracoPy", None)
    compact_messages.draco.cache_clear()
    try:
        with pytest.raises(WriterError, match=r"pip install 'carlaloc\[compact\]'"):
            Ros1Encoder(RIG, profile="compact").encode(cloud(0))
    finally:
        compact_messages.draco.cache_clear()


def test_mcap_carries_conditions_and_calibration(tmp_path: Path) -> None:
    about, files = {"weather": '{"name": "FoggyNoon"}'}, {"extrinsics.yaml": "frames: {}\n", "notes.md": "hi"}
    with Rosbag2Writer(tmp_path / "fog", Ros2Encoder(RIG), about=about, attachments=files) as writer:
        writer.write(next(drive()))
    with (tmp_path / "fog" / "fog.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        told = {record.name: record.metadata for record in reader.iter_metadata()}
        attached = {a.name: (a.media_type, a.data.decode()) for a in reader.iter_attachments()}
        assert len(list(reader.iter_messages())) == 3
        summary = reader.get_summary()
    assert told[METADATA] == about
    assert "serialized_metadata" in told["rosbag2"]
    assert attached == {
        "extrinsics.yaml": ("application/yaml", "frames: {}\n"),
        "notes.md": ("text/plain", "hi"),
    }
    assert summary is not None
    assert {chunk.compression for chunk in summary.chunk_indexes} == {"zstd"}
    assert all("offered_qos_profiles" in channel.metadata for channel in summary.channels.values())
