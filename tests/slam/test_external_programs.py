"""Programs of others by the files that we give: each that is installed is run and scored.

What is missing is skipped with what would install it. A-LOAM is built from its sources for Debian's ROS 1.
"""

from pathlib import Path

import pytest
from shared_fixtures.processes.external_programs import EXTERNAL, missing_program, missing_ros
from shared_fixtures.readings.slam_dataset import write_dataset

from recorder.benchmark.run import BenchmarkConfig, run_benchmark
from recorder.replaying.options import ReplayConfig
from recorder.replaying.replay import replay


@pytest.fixture(scope="module")
def data(short_drive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six seconds of Town03 without traffic, by the LiDAR's rig."""
    out = tmp_path_factory.mktemp("external")
    replay(
        ReplayConfig(
            episode=short_drive, out=out, rig="lidar", traffic=("static",), formats=("rosbag1",), workers=1
        )
    )
    return out


def ape_m(file: str, data: Path, out: Path) -> float:
    """Position error of a program that must not fail [m]."""
    config = BenchmarkConfig(data=data, out=out, methods=(str(EXTERNAL / file),), clouds=("raw",))
    (score,) = run_benchmark(config).scores
    assert score.failed is None
    assert score.coverage > 0.95
    return score.ape_m


@pytest.mark.parametrize("program", ["kiss_icp_pipeline", "genz_icp_pipeline", "kiss_slam_pipeline"])
def test_a_program_of_a_wheel_is_run_and_scored(program: str, tmp_path: Path) -> None:
    """Over sweeps of a box; the drive's first metres are hard for these (docs/findings.md)."""
    if missing := missing_program(program):
        pytest.skip(missing)
    data = write_dataset(tmp_path / "set", sweeps=25)
    assert ape_m(f"{program}.yaml", data, tmp_path / "out") < 0.6


def test_a_program_that_reads_calibration_and_imu_is_run_and_scored(data: Path, tmp_path: Path) -> None:
    if missing := missing_program("rko_lio"):
        pytest.skip(missing)
    assert ape_m("rko_lio_program.yaml", data, tmp_path / "out") < 0.3


def test_a_loam_is_run_by_ros_1_and_scored(data: Path, tmp_path: Path) -> None:
    if missing := missing_ros("aloam_velodyne"):
        pytest.skip(missing)
    assert ape_m("a_loam.yaml", data, tmp_path / "out") < 0.3
