"""A disk that takes no more, a folder that cannot be: one named error, nothing left behind."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.readings.bag_samples import imu

from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import Image
from recorder.writers.base import Writer
from recorder.writers.formats.euroc import EurocEncoder, EurocWriter
from recorder.writers.rig_calibration import CameraCalibration, ImuCalibration, RigCalibration
from recorder.writers.ros.rosbag1 import Ros1Encoder, Rosbag1Writer

resource = pytest.importorskip("resource")


def rig() -> RigCalibration:
    camera = CameraCalibration(name="left", T_base_camera=np.eye(4), pinhole=Pinhole())
    return RigCalibration.of(cameras=[camera], imu=ImuCalibration())


def picture(stamp_ns: int) -> Image:
    rgb = np.random.default_rng(stamp_ns).integers(0, 256, (400, 600, 3), dtype=np.uint8)
    return Image(sensor="rgb_left", frame_id="camera_left", stamp_ns=stamp_ns, rgb=rgb)


WRITERS: list[Callable[[Path], Writer]] = [
    lambda folder: Rosbag1Writer(folder / "a.bag", Ros1Encoder(rig())),
    lambda folder: EurocWriter(folder / "mav0", EurocEncoder(rig())),
]


@pytest.mark.parametrize("make", WRITERS, ids=["rosbag1", "euroc"])
def test_a_file_where_a_folder_should_be(tmp_path: Path, make: Callable[[Path], Writer]) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(WriterError, match="cannot write"):
        make(tmp_path / "file").open()


@pytest.mark.parametrize("make", WRITERS, ids=["rosbag1", "euroc"])
def test_rest_of_a_killed_run_is_replaced(tmp_path: Path, make: Callable[[Path], Writer]) -> None:
    first = make(tmp_path)
    first.open()
    first.write(picture(0))
    with make(tmp_path) as second:
        second.write(imu())
    names = [p.name for p in tmp_path.iterdir()]
    assert names in (["a.bag"], ["mav0"])
