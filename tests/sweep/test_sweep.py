"""A sweep over a real drive: its errors follow theory, and its neutral value is the benchmark."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared_fixtures.drives.straight_drives import RIG

from carlaloc_env.rigs.rig import SensorRig
from recorder.benchmark.config import BenchmarkConfig
from recorder.benchmark.run import run_benchmark
from recorder.cli.main import main
from recorder.drive.record import RecordConfig, record
from recorder.evaluation.trajectory_files import read_tum
from recorder.replaying.options import ReplayOptions
from recorder.slam.worker import ESTIMATE
from recorder.streaming.drive import DriveConfig

HEAD = """
import numpy as np
from recorder.evaluation.align import Alignment
from recorder.evaluation.trajectory_files import read_tum
from recorder.slam.system import System
SYSTEM = System(name="{name}", title="{name}", what="a test", needs=("lidar", "imu"),
                runner="x:run", frame="lidar", alignment=Alignment.NONE)
"""
PERFECT = """
def run(sequence, clock):
    # It knows where it is, and believes the stamps that it gets.
    truth, poses = read_tum(sequence.truth_file("lidar")), []
    for number, scan in enumerate(sequence.scans()):
        T = np.eye(4)
        T[:3, 3] = truth.position_m[10 * number]
        poses.append((scan.stamp_ns, T))
    return poses
"""
DIGEST = """
def run(sequence, clock):
    # Its poses are other ones where any number that it reads is.
    imu = list(sequence.imu_samples())
    inertial = np.concatenate([s.acceleration_mps2 + s.angular_velocity_radps for s in imu])
    poses = []
    for scan in sequence.scans():
        T = np.eye(4)
        T[:3, 3] = scan.points_xyz_m.sum(), scan.time_s.sum(), inertial @ np.arange(len(inertial))
        poses.append((scan.stamp_ns, T))
    return poses
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rig without cameras, and two systems."""
    folder = tmp_path_factory.mktemp("sweep")
    (folder / "rig.yaml").write_text(RIG.partition("- {kind: gnss}")[0])
    for name, body in (("perfect", PERFECT), ("digest", DIGEST)):
        (folder / f"{name}.py").write_text(HEAD.format(name=name) + body)
    return folder


@pytest.fixture(scope="module")
def moving(straight_map: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Seven seconds without others, at the end of which the car goes fast."""
    folder = tmp_path_factory.mktemp("moving")
    town = folder / "straight.xodr"
    town.write_bytes(straight_map.read_bytes())
    out, traffic = folder / "drive.mcap", "dynamic,vehicles=0,walkers=0"
    return record(RecordConfig(map=str(town), out=out, duration_s=7.0, seed=5, traffic=traffic)).path


def command(moving: Path, place: Path, *words: str) -> list[str]:
    return [
        "sweep", str(moving), "--map", str(moving.with_name("straight.xodr")),
        "--rig", str(place / "rig.yaml"), "--out", str(place / "out"),
        "--methods", f"{place}/perfect.py,{place}/digest.py",
        "--over", "fault.lidar.time_offset_ms=0,60", "--start", "6", "--duration", "0.5", "--json", *words,
    ]  # fmt: skip


def test_an_offset_of_stamps_is_an_error_of_speed_times_offset(
    moving: Path, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Rays are cast once, the neutral value gives the benchmark's bytes, a second call runs nothing."""
    import pandas as pd

    assert main(command(moving, place, "--seeds", "1")) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    out = place / "out"
    assert (found["runs"], found["reused"], found["instants"], found["frames"]) == (4, 0, 10, 20)
    runs = pd.read_csv(out / "runs.csv")
    ape_m = runs[runs["title"] == "perfect"].groupby("fault.lidar.time_offset_ms")["ape_m"].max()
    truth = read_tum(out / "drives" / "drive" / "seed5" / "straight" / "ground_truth" / "lidar.tum")
    speed_mps = np.linalg.norm(np.diff(truth.position_m, axis=0), axis=1) / 0.005
    assert speed_mps.mean() > 3.0
    assert ape_m[0.0] < 1e-6
    assert ape_m[60.0] == pytest.approx(0.06 * np.sqrt(np.mean(speed_mps**2)), rel=0.03)
    assert {"curves.csv", "areas.csv", "sweep.html", "fault.lidar.time_offset_ms.png"} <= {
        path.name for path in out.iterdir()
    }
    options, town = ReplayOptions(rig=str(place / "rig.yaml")), moving.with_name("straight.xodr")
    data = DriveConfig(episodes=(moving,), options=options, start_s=6.0, duration_s=0.5, map=town)
    plain = run_benchmark(
        BenchmarkConfig(data=data, out=place / "plain", methods=(f"{place}/digest.py",), clouds=("raw",))
    )
    estimates = [root / plain.jobs[0].folder / ESTIMATE for root in (out, place / "plain")]
    assert estimates[0].read_bytes() == estimates[1].read_bytes()
    assert main(command(moving, place, "--seeds", "1")) == 0
    again = json.loads(capsys.readouterr().out)
    assert (again["reused"], again["instants"]) == (4, 0)


def test_a_number_of_the_rig_acts_as_in_a_rig_of_its_own(
    moving: Path, place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = command(moving, place, "--seeds", "1")
    words[words.index("--over") + 1] = "rig.lidar.rate_hz=10,20"
    words[words.index("--out") + 1] = str(tmp_path / "out")
    assert main(words) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    # Half a second has five sweeps at 10 Hz, ten at 20 Hz.
    assert (found["runs"], found["frames"]) == (4, 15)
    rig = SensorRig.load(place / "rig.yaml").with_value("lidar.rate_hz", 10.0)
    (tmp_path / "slow.yaml").write_text(rig.to_yaml())
    options = ReplayOptions(rig=str(tmp_path / "slow.yaml"))
    data = DriveConfig(
        episodes=(moving,),
        options=options,
        start_s=6.0,
        duration_s=0.5,
        map=moving.with_name("straight.xodr"),
    )
    methods = (f"{place}/digest.py",)
    plain = run_benchmark(
        BenchmarkConfig(data=data, out=tmp_path / "plain", methods=methods, clouds=("raw",))
    )
    wanted = (tmp_path / "plain" / plain.jobs[0].folder / ESTIMATE).read_bytes()
    assert wanted in [path.read_bytes() for path in (tmp_path / "out").rglob(ESTIMATE)]


def test_numbers_that_the_rig_lacks_are_refused(
    moving: Path, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for over, words in {
        "rig.lidr.rate_hz=10,20": "lidr",
        "rig.lidar.rate=10,20": "rate",
        "rig.lidar.rate_hz=-5,20": "rate_hz",
    }.items():
        line = command(moving, place)
        line[line.index("--over") + 1] = over
        assert main(line) != 0
        assert words in capsys.readouterr().err
