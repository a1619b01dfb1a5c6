"""`carlaloc odometry` and `carlaloc benchmark` read the LiDAR that is asked for, and name it."""

import shutil
from pathlib import Path

import pytest
from shared_fixtures.readings.slam_dataset import write_dataset

from recorder.benchmark.run import BenchmarkConfig, run_benchmark
from recorder.cli.main import main

pytest.importorskip("small_gicp", reason="small_gicp estimates here")


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_dataset(tmp_path_factory.mktemp("two") / "set", sweeps=6, second="rear")


def odometry(capsys: pytest.CaptureFixture[str], bag: Path, *options: str) -> str:
    """Last line of the command, or of its error."""
    words = [
        "odometry",
        str(bag),
        "--method",
        "gicp",
        "--force",
        "--out",
        str(bag.parents[2] / "e.tum"),
        *options,
    ]
    main(words)
    printed = capsys.readouterr()
    return (printed.out + printed.err).strip().splitlines()[-1]


def test_odometry_names_what_it_reads(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The bag has two LiDARs, and of the second our message and its driver's."""
    bag = data / "Box" / "ClearNoon_dynamic" / "ClearNoon_dynamic.bag"
    assert odometry(capsys, bag) == "read: /lidar/points of LiDAR lidar"
    assert odometry(capsys, bag, "--lidar", "rear") == "read: /rear/points of LiDAR rear"
    assert odometry(capsys, bag, "--topic", "/velodyne_points") == "read: /velodyne_points"
    assert "no LiDAR 'front'" in odometry(capsys, bag, "--lidar", "front")
    alone = data.parent / "a" / "b" / "c.bag"
    alone.parent.mkdir(parents=True)
    shutil.copy(bag, alone)
    assert odometry(capsys, alone) == "read: /lidar/points"
    assert "lies in no dataset" in odometry(capsys, alone, "--lidar", "rear")


def test_benchmark_names_what_systems_read(data: Path, tmp_path: Path) -> None:
    """Results of two LiDARs lie beside each other."""
    found = {}
    for lidar in (None, "rear"):
        config = BenchmarkConfig(
            data=data, out=tmp_path, methods=("small_gicp",), clouds=("raw",), lidar=lidar
        )
        result = run_benchmark(config)
        (score,), (job,) = result.scores, result.jobs
        assert score.failed is None
        assert result.reused == 0
        found[score.lidar] = job.folder.parent.name
    assert found == {"lidar": "small_gicp", "rear": "small_gicp_rear"}
