"""Two makings of one dataset: pictures and events may differ within their bounds, nothing else may."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from shared_fixtures.drives.straight_drives import StraightDrive
from shared_fixtures.readings.bag_samples import batch_of
from shared_fixtures.worlds.render_scenes import need_opengl

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.samples import EVENT
from recorder.cli.main import main
from recorder.dataset.checksums import write_checksums
from recorder.replaying.replay import replay
from recorder.verification.against import compare, of_events, of_pictures
from recorder.verification.verify import verify
from recorder.writers.rig_calibration import RigCalibration
from recorder.writers.ros.event_messages import unpacked_events
from recorder.writers.ros.rosbag1 import Ros1Encoder
from recorder.writers.ros.rosbag2 import Ros2Encoder

SEQUENCE = "straight/ClearNoon_dynamic"
Change = Callable[[Path], None]


@pytest.fixture(scope="module")
def whole(straight_drive: StraightDrive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four tenths of a second with LiDAR, labels, events and a stereo pair, in three formats."""
    out = tmp_path_factory.mktemp("against") / "data"
    config = straight_drive.config(
        out, rig=str(straight_drive.rig), formats=("rosbag1", "euroc", "raw"), topics="full", duration_s=0.4,
        start_s=1.0, preview=False,
    )  # fmt: skip
    need_opengl()
    replay(config)
    return out


def _change_png(steps: int, values: int, where: str = "mav0/cam0/data/*.png") -> Change:
    def change(data: Path) -> None:
        path = sorted((data / SEQUENCE).glob(where))[2]
        picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert picture is not None
        flat = picture.reshape(-1)
        flat[:values] = np.where(flat[:values] < 128, flat[:values] + steps, flat[:values] - steps)
        cv2.imwrite(str(path), picture)

    return change


def _change_message(topic: str, at: int) -> Change:
    """One byte of a message by one step, in a bag that is not compressed."""

    def change(data: Path) -> None:
        path = data / SEQUENCE / "ClearNoon_dynamic.bag"
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS1_NOETIC)) as bag:
            message = next(bytes(raw) for link, _, raw in bag.messages() if link.topic == topic)
        content = path.read_bytes()
        assert content.count(message) == 1
        changed = bytearray(message)
        changed[at] ^= 1
        path.write_bytes(content.replace(message, bytes(changed)))

    return change


CHANGES: dict[str, tuple[Change, str]] = {
    "one value by one step": (_change_png(1, 1), ""),
    "one value by two steps": (_change_png(2, 1), "a value differs by 2 steps, 1 is the bound"),
    "many values": (_change_png(1, 40), "of its values differ, 0.0001 is the bound"),
    "a label": (_change_png(1, 1, "raw/semantic_left/*.png"), "has other bytes"),
    "a value in a bag": (_change_message("/camera/left/image_raw", -1), ""),
    "a stamp in a bag": (_change_message("/camera/left/image_raw", 4), "has another header"),
    "a stamp of events in a bag": (_change_message("/camera/left/events", 4), "has another header"),
    "a point in a bag": (_change_message("/lidar/points", -1), "/lidar/points at"),
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_change_is_within_its_bound_or_named(name: str, whole: Path, tmp_path: Path) -> None:
    change, line = CHANGES[name]
    shutil.copytree(whole, tmp_path / "data")
    change(tmp_path / "data")
    found = compare(tmp_path / "data", whole)
    assert (len(found.within), len(found.findings)) == ((0, 1) if line else (1, 0)), found
    assert line in "".join(found.findings)


def test_events_of_raw_files_may_differ_a_little(whole: Path, tmp_path: Path) -> None:
    shutil.copytree(whole, tmp_path / "data")
    path = max((tmp_path / "data" / SEQUENCE / "raw/events_left").iterdir(), key=lambda p: p.stat().st_size)
    arrays = dict(np.load(path))
    for count, within in ((1, True), (len(arrays["events"]) // 2, False)):
        moved = arrays["events"].copy()
        moved["x"][:count] ^= 1
        np.savez_compressed(path, **{**arrays, "events": moved})
        assert bool(compare(tmp_path / "data", whole).within) is within


def test_the_command_says_how_many_and_fails_on_what_is_beyond(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = tmp_path / "data"
    shutil.copytree(whole, data)
    assert main(["verify", str(data), "--against", str(whole)]) == 0
    assert "differ within" not in capsys.readouterr().out
    _change_png(1, 1)(data)
    # As if it had been made so, elsewhere.
    (data / SEQUENCE / "SHA256SUMS").unlink()
    write_checksums(data / SEQUENCE)
    write_checksums(data)
    assert main(["verify", str(data), "--against", str(whole)]) == 0
    assert "1 files differ within the bounds" in capsys.readouterr().out
    (data / SEQUENCE / "mav0/imu0/data.csv").write_text("")
    assert main(["verify", str(data), "--against", str(whole), "--json"]) == 1
    assert (
        f"{SEQUENCE}/mav0/imu0/data.csv: has other bytes" in json.loads(capsys.readouterr().out)["findings"]
    )


def test_what_is_in_one_alone_is_named(whole: Path, tmp_path: Path) -> None:
    shutil.copytree(whole, tmp_path / "data")
    table = f"{SEQUENCE}/mav0/imu0/data.csv"
    (tmp_path / "data" / table).unlink()
    assert f"{table}: only in {whole}" in verify(tmp_path / "data", against=whole).findings
    assert f"{table}: not in {tmp_path / 'data'}" in compare(whole, tmp_path / "data").findings
    with pytest.raises(ConfigError, match=r"holds no dataset\.yaml"):
        compare(whole, tmp_path)


@pytest.mark.parametrize("count", [0, 1, 2, 500])
@pytest.mark.parametrize("kind", [Ros1Encoder, Ros2Encoder])
def test_events_come_out_of_messages_as_they_went_in(
    count: int, kind: type[Ros1Encoder | Ros2Encoder]
) -> None:
    draw = np.random.default_rng(count)
    events = np.zeros(count, EVENT)
    for name, end in (("t", 50_000_000), ("x", 1280), ("y", 720), ("p", 2)):
        events[name] = draw.integers(0, end, count)
    bag = kind(RigCalibration.from_configs(()), profile="full")
    head, rows = unpacked_events(bag.encode(batch_of(events))[0].data)
    assert b"camera_left" in head
    assert (rows["t"] - bag.epoch_ns).tolist() == events["t"].tolist()
    assert [rows[name].tolist() for name in "xyp"] == [events[name].tolist() for name in "xyp"]


def test_bounds_of_arrays() -> None:
    picture = np.full((100, 100), 7, np.uint8)
    other = picture.copy()
    other[3, 4] = 8
    assert of_pictures(picture, other) == ""
    assert of_pictures(picture, other[1:]) == "has other bytes"
    assert of_pictures(picture.astype(np.uint16), other.astype(np.uint16)) == "has other bytes"
    other[3, 5] = 6
    assert "0.0002 of its values differ" in of_pictures(picture, other)
    events = np.zeros(1000, [("t", "<i8"), ("x", "<u2")])
    events["t"] = np.arange(1000)
    assert of_events(events, events[20:]) == ""
    assert of_events(events, events[::-1]) == ""
    assert "0.1 of its events stand in one alone" in of_events(events, events[100:])
