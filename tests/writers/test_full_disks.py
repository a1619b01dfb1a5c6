"""Every format on disks of many sizes: a whole file, or one named error and nothing left."""

import gc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.processes.small_disks import small_disk
from shared_fixtures.readings.bag_samples import batch_of, cloud_of, imu, truth, write_all

from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import EVENT, Image, Sample
from recorder.writers.base import Writer
from recorder.writers.formats.colmap import ColmapEncoder, ColmapWriter
from recorder.writers.formats.dsec import DsecEncoder, DsecWriter
from recorder.writers.formats.euroc import EurocEncoder, EurocWriter
from recorder.writers.formats.kitti import KittiEncoder, KittiWriter
from recorder.writers.formats.nuscenes import NuscenesEncoder, NuscenesWriter
from recorder.writers.formats.opv2v import Opv2vEncoder, Opv2vWriter
from recorder.writers.formats.preview_video import PreviewEncoder, PreviewWriter
from recorder.writers.formats.town_ground import TownGround
from recorder.writers.rig_calibration import (
    CameraCalibration,
    ImuCalibration,
    LidarCalibration,
    RigCalibration,
)
from recorder.writers.ros.rosbag1 import Ros1Encoder, Rosbag1Writer
from recorder.writers.ros.rosbag2 import Ros2Encoder, Rosbag2Writer

WIDTH, HEIGHT, STEP_NS, STEPS = 96, 64, 50_000_000, 6
EYE = Pinhole.from_fov(WIDTH, HEIGHT, 90.0)
STREAMS = ("lidar_semantic", "rgb_left")
GROUND = TownGround(
    name="a", origin_m=np.zeros(2), mask=np.zeros((9, 9), np.uint8), parked_centre_m=np.zeros((0, 3)),
    parked_heading_rad=np.zeros(0), parked_size_m=np.zeros((0, 3)),
)  # fmt: skip
RIG = RigCalibration.of(
    cameras=[CameraCalibration(name="left", T_base_camera=np.eye(4), pinhole=EYE)],
    imu=ImuCalibration(),
    lidar=LidarCalibration(),
)
WRITERS: dict[str, Callable[[Path], Writer]] = {
    "rosbag1": lambda folder: Rosbag1Writer(folder / "a.bag", Ros1Encoder(RIG, profile="full")),
    "rosbag2": lambda folder: Rosbag2Writer(folder / "a", Ros2Encoder(RIG, profile="full")),
    "rosbag2_sqlite3": lambda folder: Rosbag2Writer(
        folder / "a", Ros2Encoder(RIG, profile="full"), storage="sqlite3"
    ),
    "euroc": lambda folder: EurocWriter(folder / "mav0", EurocEncoder(RIG)),
    "kitti": lambda folder: KittiWriter(folder / "kitti", KittiEncoder(RIG)),
    "nuscenes": lambda folder: NuscenesWriter(
        folder / "nuscenes", NuscenesEncoder(RIG, STREAMS), ground=lambda: GROUND, about={}
    ),
    "opv2v": lambda folder: Opv2vWriter(
        folder / "opv2v", Opv2vEncoder(RIG, STREAMS), ground=lambda: GROUND, agent=7, about={}
    ),
    "colmap": lambda folder: ColmapWriter(folder / "colmap", ColmapEncoder(RIG, STREAMS)),
    "dsec": lambda folder: DsecWriter(folder / "events_left.h5", DsecEncoder("events_left")),
    "preview": lambda folder: PreviewWriter(
        folder / "preview.mp4", PreviewEncoder({"rgb_left": "rgb"}), rate_hz=20.0
    ),
}


def _drive() -> list[Sample]:
    """Noise, which no compression makes small."""
    rng = np.random.default_rng(0)
    samples: list[Sample] = []
    for stamp in range(0, STEPS * STEP_NS, STEP_NS):
        count = 4000 if stamp else 0
        events = np.zeros(count, EVENT)
        events["t"] = stamp + np.sort(rng.integers(0, STEP_NS, count)) - STEP_NS + 1
        events["x"], events["y"] = rng.integers(0, WIDTH, count), rng.integers(0, HEIGHT, count)
        samples += [
            batch_of(events, stamp, (WIDTH, HEIGHT), STEP_NS),
            Image(
                sensor="rgb_left", frame_id="camera_left", stamp_ns=stamp,
                rgb=rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8),
            ),
            cloud_of(rng.normal(size=(3000, 3)), stamp, sweep_ns=STEP_NS, cos_incidence=1.0),
        ]  # fmt: skip
        for tick in range(stamp, stamp + STEP_NS, 5_000_000):
            values = np.random.default_rng(tick).normal(size=(2, 3))
            samples += [imu(tick, *values), truth(tick, (tick / 1e9, 0.0, 0.0))]
    return samples


def _contents(folder: Path) -> dict[str, int]:
    return {
        str(path.relative_to(folder)): path.stat().st_size for path in folder.rglob("*") if path.is_file()
    }


@pytest.mark.filterwarnings("error::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("name", WRITERS)
def test_whole_or_nothing(tmp_path: Path, name: str, capfd: pytest.CaptureFixture[str]) -> None:
    make, samples = WRITERS[name], _drive()

    def write(folder: Path) -> None:
        write_all(make(folder), samples)

    (tmp_path / "whole").mkdir()
    write(tmp_path / "whole")
    whole = _contents(tmp_path / "whole")
    errors = []
    capfd.readouterr()
    for part in (0.01, 0.1, 0.4, 0.7, 0.9, 0.97, 0.995, 3.0):
        with small_disk(tmp_path / "disk", max(round(part * sum(whole.values())), 8192)) as disk:
            try:
                write(disk)
                assert _contents(disk).keys() == whole.keys(), part
            except WriterError as error:
                errors.append(str(error))
                assert list(disk.iterdir()) == [], part
            gc.collect()
    assert 3 <= len(errors) <= 7
    assert all("No space left" in error or "disk is full" in error for error in errors), errors
    assert capfd.readouterr().err == ""
