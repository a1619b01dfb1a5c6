"""A stretch that begins in motion is reported, with the nearest instant at rest."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.drives.straight_drives import StraightDrive
from shared_fixtures.readings.slam_dataset import list_dataset, rig, write_dataset

from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.sensors.lidar_config import LidarConfig
from recorder.benchmark.notes import notes_on
from recorder.benchmark.plan import find_sequences
from recorder.cli.main import main
from recorder.drive.record import RecordConfig, record
from recorder.replaying.start_at_rest import motion_at_start
from recorder.slam.systems import SYSTEMS


@pytest.mark.parametrize(
    ("start_s", "words"),
    [(0.0, None), (2.0, None), (3.0, "1.0 m/s"), (4.0, "--start 2"), (8.0, "--start 9"), (9.5, None)],
)
def test_the_nearest_instant_at_rest_is_offered(start_s: float, words: str | None) -> None:
    """A car that stands until 2 s, drives off by 1 m/s² and stops from 7 to 9 s."""
    at_s = np.arange(0.0, 12.0, 0.05)
    speed_mps = np.clip(np.minimum(at_s - 2.0, 2.5 * (9.0 - at_s)), 0.0, 5.0)
    line = motion_at_start(at_s, speed_mps, start_s)
    assert (words in line) if words else line == ""
    assert "nowhere" in motion_at_start(at_s, speed_mps + 1.0, start_s)


def test_replay_says_so(
    straight_drive: StraightDrive, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The scripted driver stands for three seconds."""
    drive = replace(straight_drive, episode=tmp_path / "longer.mcap")
    record(RecordConfig(map=str(drive.town), out=drive.episode, duration_s=5.0, traffic="empty"))
    for start, expected in (("0", 0), ("4.5", 1)):
        words = drive.command(tmp_path / start, "--start", start, "--duration", "0.5")[3:]
        assert main([*words, "--format", "euroc", "--workers", "1", "--no-preview"]) == 0
        lines = [line for line in capfd.readouterr().err.splitlines() if "false start" in line]
        assert len(lines) == expected
        assert all("is --start 3" in line for line in lines)


def test_a_benchmark_says_so_and_which_of_two_lidars_it_reads(tmp_path: Path) -> None:
    """By the truth, where the data lie in a folder: the car of this dataset never stands."""
    root = write_dataset(tmp_path / "data", sweeps=3)
    two = SensorRig(name="two", sensors=(*rig(with_imu=False).sensors, LidarConfig(name="rear")))
    list_dataset(root, two)
    lines = notes_on(find_sequences(root), [SYSTEMS["kiss_icp"], SYSTEMS["small_gicp"]])
    assert lines[0] == "rig two: systems read lidar lidar, the first, not rear"
    assert "Box begins at" in lines[1]
    assert len(lines) == 2
