"""Bags of every kind and DSEC's event files of two makings: what may differ passes, all else is named."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
from shared_fixtures.readings.bag_samples import batch_of, drive, rig, write_all

from carlaloc_env.samples import EVENT, DepthImage, Image, Imu, PointCloud, Sample, SemanticImage
from recorder.verification.against import differences
from recorder.writers.base import jpeg_of
from recorder.writers.formats.dsec import DsecEncoder, DsecWriter
from recorder.writers.ros.rosbag1 import Ros1Encoder, Rosbag1Writer
from recorder.writers.ros.rosbag2 import Ros2Encoder, Rosbag2Writer

Make = Callable[[Path, list[Sample]], Path]
AT = 100_000_000
"""Stamp of the samples that are changed [ns]."""


def _rosbag1(folder: Path, samples: list[Sample]) -> Path:
    return write_all(Rosbag1Writer(folder / "some.bag", Ros1Encoder(rig())), samples)


def _rosbag2(storage: str) -> Make:
    def make(folder: Path, samples: list[Sample]) -> Path:
        write_all(Rosbag2Writer(folder / "some", Ros2Encoder(rig()), storage=storage), samples)
        return next((folder / "some").glob("*.mcap" if storage == "mcap" else "*.db3"))

    return make


BAGS: dict[str, Make] = {"rosbag1": _rosbag1, "mcap": _rosbag2("mcap"), "sqlite3": _rosbag2("sqlite3")}


def _brighter(steps: int) -> Callable[[Sample], Sample]:
    """One value of a picture in 10 000 brighter, as far as there are so many."""

    def change(sample: Sample) -> Sample:
        assert isinstance(sample, Image)
        rgb = np.full_like(sample.rgb, 100)
        rgb[0, 0, 0] += steps
        return replace(sample, rgb=rgb)

    return change


def _depth(sample: Sample) -> Sample:
    assert isinstance(sample, DepthImage)
    return replace(sample, depth_m=np.nextafter(sample.depth_m, np.float32(9)))


def _label(sample: Sample) -> Sample:
    assert isinstance(sample, SemanticImage)
    tag = sample.tag.copy()
    tag[3, 4] ^= 1
    return replace(sample, tag=tag)


def _point(sample: Sample) -> Sample:
    assert isinstance(sample, PointCloud)
    points = sample.points_xyz_m.copy()
    points[7, 2] = np.nextafter(points[7, 2], np.float32(9))
    return replace(sample, points_xyz_m=points)


def _force(sample: Sample) -> Sample:
    assert isinstance(sample, Imu)
    return replace(sample, specific_force_mps2=np.nextafter(sample.specific_force_mps2, 9.0))


CHANGES: dict[str, tuple[str, Callable[[Sample], Sample], str]] = {
    "picture, two steps": ("rgb_left", _brighter(2), "a value differs by 2 steps"),
    "depth, one bit": ("depth_left", _depth, "has other bytes"),
    "label": ("semantic_left", _label, "has other bytes"),
    "point, one bit": ("lidar_semantic", _point, "/lidar/points"),
    "acceleration, one bit": ("imu", _force, "/imu/data"),
}


def _changed(sensor: str, change: Callable[[Sample], Sample]) -> list[Sample]:
    return [change(s) if (s.sensor, s.stamp_ns) == (sensor, AT) else s for s in drive()]


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The drive as it is in bags of each kind."""
    return {kind: make(tmp_path_factory.mktemp(kind), drive()) for kind, make in BAGS.items()}


@pytest.mark.parametrize("name", CHANGES)
@pytest.mark.parametrize("kind", BAGS)
def test_a_changed_message_of_a_bag_is_named(
    kind: str, name: str, plain: dict[str, Path], tmp_path: Path
) -> None:
    sensor, change, line = CHANGES[name]
    ours, theirs = BAGS[kind](tmp_path / "ours", _changed(sensor, change)), plain[kind]
    if sensor == "rgb_left":
        # Beside a picture of one tone, so that only the steps differ.
        theirs = BAGS[kind](tmp_path / "theirs", _changed(sensor, _brighter(0)))
    found = differences(ours, theirs)
    assert line in found
    assert str(AT % 1_000_000_000) in found


@pytest.mark.parametrize("kind", BAGS)
def test_a_picture_in_a_bag_may_differ_by_a_step(kind: str, tmp_path: Path) -> None:
    """One value of 32×24×3 is more than one in 10 000; in a larger picture it is within the bound."""
    samples = drive()
    wide = [replace(s, rgb=np.full((90, 120, 3), 100, np.uint8)) for s in samples if isinstance(s, Image)]
    other = [_brighter(1)(s) if (s.sensor, s.stamp_ns) == ("rgb_left", AT) else s for s in wide]
    ours, theirs = BAGS[kind](tmp_path / "ours", list(other)), BAGS[kind](tmp_path / "theirs", list(wide))
    assert ours.read_bytes() != theirs.read_bytes()
    assert differences(ours, theirs) == ""


@pytest.mark.parametrize("kind", BAGS)
def test_a_bag_that_lacks_a_message_is_named(kind: str, plain: dict[str, Path], tmp_path: Path) -> None:
    less = [s for s in drive() if (s.sensor, s.stamp_ns) != ("imu", AT)]
    ours = BAGS[kind](tmp_path / "ours", less)
    assert "messages differ from" in differences(ours, plain[kind])
    last = BAGS[kind](tmp_path / "last", drive()[:-1])
    assert differences(last, plain[kind]) != ""
    assert differences(plain[kind], plain[kind]) == ""


@pytest.fixture
def events(tmp_path: Path) -> Path:
    """Half a second of events in DSEC's layout."""
    path = tmp_path / "events.h5"
    with DsecWriter(path, DsecEncoder("events_left")) as writer:
        for stamp in range(50_000_000, 500_000_001, 50_000_000):
            rows = np.zeros(1000, EVENT)
            rows["t"] = stamp - 50_000_000 + np.arange(1, 1001) * 50_000
            rows["x"], rows["y"], rows["p"] = np.arange(1000) % 640, np.arange(1000) % 480, 1
            writer.write(batch_of(rows, stamp, (640, 480)))
    return path


@pytest.mark.parametrize(("share", "line"), [(0.01, ""), (0.1, "of its events stand in one alone")])
def test_events_of_dsec_may_differ_in_a_few(share: float, line: str, events: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.h5"
    shutil.copyfile(events, other)
    with h5py.File(other, "r+") as file:
        column = file["events/x"]
        values = column[()]
        # A moved event stands alone twice: here and there.
        values[: int(share * len(values))] ^= 1
        column[...] = values
    assert line in differences(other, events)
    assert bool(differences(other, events)) is bool(line)


@pytest.mark.parametrize("name", ["t_offset", "ms_to_idx"])
def test_the_index_of_dsec_follows_from_events_and_its_offset_does_not(
    name: str, events: Path, tmp_path: Path
) -> None:
    other = tmp_path / "other.h5"
    shutil.copyfile(events, other)
    with h5py.File(other, "r+") as file:
        column = file[name]
        column[...] = column[()] + 1
    assert differences(other, events) == ("t_offset differs" if name == "t_offset" else "")


@pytest.mark.parametrize(("steps", "values", "finding"), [(1, 20, ""), (60, 20, "steps, 8 is the bound")])
def test_pictures_that_differ_in_a_step_do_so_as_jpeg(
    steps: int, values: int, finding: str, tmp_path: Path
) -> None:
    """A JPEG spreads a step of one value over its block; a stain of many steps is found."""
    draw = np.random.default_rng(4)
    rgb = cv2.resize(draw.integers(40, 200, (30, 40, 3), dtype=np.uint8), (640, 480))
    other = rgb.copy()
    other.reshape(-1)[draw.choice(rgb.size, values, replace=False)] += np.uint8(steps)
    paths = tmp_path / "ours.jpg", tmp_path / "theirs.jpg"
    for path, picture in zip(paths, (rgb, other), strict=True):
        path.write_bytes(jpeg_of(picture, "picture", 95))
    assert paths[0].read_bytes() != paths[1].read_bytes()
    found = differences(*paths)
    assert finding in found
    assert bool(found) == bool(finding)
