"""Calibration against data in bags of other topics: compressed depth and clouds, and the paper's names."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from shared_fixtures.drives.straight_drives import StraightDrive
from shared_fixtures.worlds.render_scenes import need_opengl

from recorder.replaying.replay import replay
from recorder.verification.verify import verify


@pytest.fixture(scope="module")
def datasets(straight_drive: StraightDrive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A second of the same drive by the topics `compact_full` and `paper`."""
    pytest.importorskip("DracoPy", reason="clouds of the profile compact need DracoPy")
    need_opengl()
    out = tmp_path_factory.mktemp("verify_topics")
    for topics, formats in (("compact_full", ("rosbag2",)), ("paper", ("rosbag1",))):
        config = straight_drive.config(
            out / topics, rig=str(straight_drive.rig), formats=formats, topics=topics, duration_s=1.0,
            unit_s=10.0, preview=False,
        )  # fmt: skip
        replay(config)
    return out


def lidar_is_higher(T: list[list[float]]) -> None:
    T[2][3] += 1.5


def imu_is_turned(T: list[list[float]]) -> None:
    T[:3] = [[1.0, 0.0, 0.0, T[0][3]], [0.0, 0.0, -1.0, T[1][3]], [0.0, 1.0, 0.0, T[2][3]]]


@pytest.mark.parametrize("topics", ["compact_full", "paper"])
def test_a_whole_dataset_has_nothing_wrong(topics: str, datasets: Path) -> None:
    assert verify(datasets / topics).findings == ()


@pytest.mark.parametrize(
    ("topics", "frame", "change", "line"),
    [
        ("compact_full", "lidar", lidar_is_higher, "LiDAR does not fit /camera/left/depth/compressedDepth"),
        ("compact_full", "imu", imu_is_turned, "IMU does not fit the truth: accelerations"),
        ("paper", "imu", imu_is_turned, "IMU does not fit the truth: accelerations"),
    ],
)
def test_calibration_that_does_not_fit_is_named(
    topics: str, frame: str, change: Callable[[list[list[float]]], None], line: str, datasets: Path,
    tmp_path: Path,
) -> None:  # fmt: skip
    data = tmp_path / "data"
    shutil.copytree(datasets / topics, data)
    path = data / "straight/calibration/extrinsics.yaml"
    document = yaml.safe_load(path.read_text())
    change(document["frames"][frame][f"T_base_link_{frame}"])
    path.write_text(yaml.safe_dump(document))
    findings = verify(data).findings
    assert [found for found in findings if line in found], findings
