"""A disk that takes no more, a folder that cannot be: one named error, nothing left behind."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.readings.bag_samples import imu

from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.errors import EpisodeError, WriterError
from carlaloc_env.samples import Image
from recorder.episode.episode import EgoRow, EpisodeHeader, EpisodeWriter, open_episode
from recorder.writers.base import Writer
from recorder.writers.formats.euroc import EurocEncoder, EurocWriter
from recorder.writers.rig_calibration import CameraCalibration, ImuCalibration, RigCalibration
from recorder.writers.ros.rosbag1 import Ros1Encoder, Rosbag1Writer

resource = pytest.importorskip("resource")


@pytest.fixture
def small_files() -> Iterator[None]:
    """The kernel refuses to let any file grow beyond 100 kB."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


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
@pytest.mark.usefixtures("small_files")
def test_disk_that_takes_no_more(tmp_path: Path, make: Callable[[Path], Writer]) -> None:
    def drive() -> None:
        with make(tmp_path) as writer:
            for k in range(20):
                writer.write(picture(k))

    with pytest.raises(WriterError, match="cannot write"):
        drive()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("small_files")
def test_episode_on_a_disk_that_takes_no_more(tmp_path: Path) -> None:
    writer = EpisodeWriter(tmp_path / "a.mcap", EpisodeHeader(map_name="Town03"))
    rng = np.random.default_rng(0)

    def drive() -> None:
        for tick in range(5000):
            writer.ego(tick, EgoRow(position_m=rng.normal(size=3), quat_xyzw=rng.normal(size=4)))

    with pytest.raises(EpisodeError, match="safe there"):
        drive()
    episode = open_episode(tmp_path / "a.mcap")
    assert len(episode.ego) > 500
    assert episode.problem == "the file was not closed"


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
