"""A replay with faults and its twin without: truth and every untouched stream have the same bytes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from shared_fixtures.drives.straight_drives import RIG, StraightDrive

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.faults.faults import Faults
from carlaloc_env.rigs.rig import SensorRig
from recorder.bags.reader import open_bag
from recorder.benchmark.config import BenchmarkConfig
from recorder.benchmark.run import run_benchmark
from recorder.cli.main import main
from recorder.dataset.layout import SequenceFolder
from recorder.dataset.manifest import DatasetManifest
from recorder.replaying.condition_file import ConditionFile
from recorder.replaying.options import ReplayOptions
from recorder.replaying.replay import replay
from recorder.streaming.drive import DriveConfig


def files(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()
    }


def messages(sequence: Path) -> dict[str, list[bytes]]:
    with open_bag(SequenceFolder(sequence).bags[0]) as reader:
        found: dict[str, list[bytes]] = {}
        for connection, _, data in reader.messages():
            found.setdefault(connection.topic, []).append(bytes(data))
    return found


def made(drive: StraightDrive, out: Path, *words: str) -> Path:
    """The dataset of a replay."""
    replay(drive.config(out, faults=Faults.parse(words), formats=("rosbag2",), preview=False))
    return out


@pytest.fixture(scope="module")
def twins(straight_drive: StraightDrive, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Without faults, with neutral ones, and with a faulty IMU in the first one's folder."""
    folder = tmp_path_factory.mktemp("twins")
    clean, neutral = folder / "clean", folder / "neutral"
    made(straight_drive, clean)
    made(straight_drive, neutral, "imu.time_offset_ms=0", "gnss.drop_share=0")
    before = files(clean / "straight" / "ground_truth")
    made(straight_drive, clean, "imu.accel_bias_mps2=0.5", "imu.time_offset_ms=2")
    assert files(clean / "straight" / "ground_truth") == before
    return [clean, neutral]


def test_neutral_faults_give_the_same_bytes(twins: list[Path]) -> None:
    clean, neutral = (files(one / "straight" / "ClearNoon_dynamic") for one in twins)
    assert clean == neutral


def test_untouched_streams_are_the_same_and_the_description_names_the_faults(twins: list[Path]) -> None:
    sound = twins[0] / "straight" / "ClearNoon_dynamic"
    (faulty,) = (twins[0] / "straight").glob("ClearNoon_dynamic_*")
    bags = [messages(folder) for folder in (sound, faulty)]
    changed = {topic for topic in bags[0] if bags[0][topic] != bags[1][topic]}
    assert changed == {"/imu/data"}
    assert set(bags[0]) >= {"/imu/data", "/gnss/fix", "/ground_truth/odometry"}
    description = yaml.safe_load((faulty / "sequence.yaml").read_text())
    assert description["faults"] == {"imu": {"accel_bias_mps2": 0.5, "time_offset_ms": 2.0}}
    assert "faults" not in yaml.safe_load((sound / "sequence.yaml").read_text())


def test_a_wrong_calibration_changes_calibration_alone(
    straight_drive: StraightDrive, twins: list[Path], tmp_path: Path
) -> None:
    out = made(straight_drive, tmp_path / "out", "gnss.calib_x_m=0.5")
    clean = twins[0] / "straight"
    assert files(out / "straight" / "ground_truth") == files(clean / "ground_truth")
    (folder,) = (out / "straight").glob("ClearNoon_dynamic_*")
    bags = [messages(one) for one in (clean / "ClearNoon_dynamic", folder)]
    assert {topic for topic in bags[0] if bags[0][topic] != bags[1][topic]} == {"/tf_static"}
    believed, true = (DatasetManifest.read(one).rig("straight").of_kind("gnss")[0] for one in (out, twins[0]))
    moved = np.array(believed.mount.position_m) - np.array(true.mount.position_m)
    assert moved.tolist() == [0.5, 0.0, 0.0]


def test_a_rig_and_a_condition_hold_faults(straight_drive: StraightDrive, tmp_path: Path) -> None:
    rig = SensorRig.from_yaml(straight_drive.state_rig.read_text() + "faults: {gnss: {drop_share: 1.0}}\n")
    assert SensorRig.from_yaml(rig.to_yaml()) == rig
    (tmp_path / "rig.yaml").write_text(rig.to_yaml())
    condition = ConditionFile(faults={"imu": {"drop_share": 1.0}}, start_s=0.5, duration_s=0.5)
    (tmp_path / "condition.yaml").write_text(condition.to_yaml())
    assert ConditionFile.read(tmp_path / "condition.yaml") == condition
    words = straight_drive.command(tmp_path / "out", rig=tmp_path / "rig.yaml")[3:]
    assert main([*words, "--condition", str(tmp_path / "condition.yaml"), "--format", "rosbag2"]) == 0
    (folder,) = (tmp_path / "out" / "straight").glob("ClearNoon_*")
    samples = yaml.safe_load((folder / "sequence.yaml").read_text())["samples"]
    assert "imu" not in samples
    assert "gnss" not in samples


def test_formats_that_compute_with_the_calibration_refuse_its_faults(
    straight_drive: StraightDrive, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match="kitti computes with the calibration"):
        straight_drive.config(tmp_path, formats=("kitti",), faults=Faults.parse(["lidar.calib_x_m=1"]))


DIGEST = """
import numpy as np
from recorder.slam.system import System
SYSTEM = System(name="d", title="d", what="a test", needs=("lidar", "imu"), runner="x:run", frame="lidar")
def run(sequence, clock):
    imu = np.array([[s.stamp_ns % 1e9, *s.acceleration_mps2] for s in sequence.imu_samples()])
    poses = []
    for scan in sequence.scans():
        T = np.eye(4)
        T[:3, 3] = scan.points_xyz_m.sum(), len(scan.ring), np.arange(imu.size) @ imu.ravel()
        poses.append((scan.stamp_ns, T))
    return poses
"""


@pytest.mark.soak
def test_a_system_reads_the_same_faults_from_a_drive_and_from_a_dataset(
    straight_drive: StraightDrive, tmp_path: Path
) -> None:
    words = ["lidar.drop_share=0.3", "lidar.time_offset_ms=7"]
    words += ["lidar.crosstalk_share=0.2", "imu.burst_share=0.3"]
    (tmp_path / "rig.yaml").write_text(RIG.partition("- {kind: gnss}")[0])
    (tmp_path / "d.py").write_text(DIGEST)
    shared: dict[str, Any] = {"rig": str(tmp_path / "rig.yaml"), "faults": Faults.parse(words)}
    replay(straight_drive.config(tmp_path / "data", formats=("rosbag1",), preview=False, **shared))
    drive = DriveConfig(
        episodes=(straight_drive.episode,), options=ReplayOptions(**shared), map=straight_drive.town
    )
    found = []
    for number, data in enumerate((tmp_path / "data", drive)):
        config = BenchmarkConfig(
            data=data, out=tmp_path / f"{number}", methods=(str(tmp_path / "d.py"),), clouds=("raw",)
        )
        result = run_benchmark(config)
        found.append((result.out / result.jobs[0].folder / "estimate.tum").read_bytes())
    assert found[0] == found[1]
    assert 15 < found[0].count(b"\n") < 40  # of 40 sweeps
