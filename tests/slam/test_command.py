"""Systems that are programs: a real one that copies the truth, and ones that fail."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.readings.slam_dataset import write_dataset

from carlaloc_env.core.errors import EvaluationError
from recorder.dataset.sequence import SlamSequence
from recorder.evaluation.trajectory_files import read_tum
from recorder.slam.runners.command import run_command
from recorder.slam.system import FrameClock

COPY = "import shutil, sys; shutil.copy(sys.argv[1] + '/../ground_truth/lidar.tum', sys.argv[2])"


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> SlamSequence:
    root = write_dataset(tmp_path_factory.mktemp("d"), sweeps=3)
    (root / "Box" / "calibration").mkdir()
    return SlamSequence(root / "Box" / "ClearNoon_dynamic")


def test_poses_are_those_that_the_program_wrote(sequence: SlamSequence) -> None:
    clock = FrameClock()
    words = [sys.executable, "-c", COPY, "{calibration}", "{out}"]
    poses = run_command(sequence, clock, words, sensor="lidar")
    truth = read_tum(sequence.truth_file("lidar"))
    assert [stamp for stamp, _ in poses] == truth.stamp_ns.tolist()
    assert np.array_equal(np.stack([T[:3, 3] for _, T in poses]), truth.position_m)
    assert len(clock.wall_s) == 3
    assert sum(clock.wall_s) > 0.001


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["no_such_program_of_ours"], "cannot start no_such_program_of_ours"),
        ([sys.executable, "-c", "raise SystemExit(3)"], "ended with 3"),
        (["sh", "-c", "no_such_program_of_ours"], "sh did not find a program"),
        ([sys.executable, "-c", "pass", "{bag}"], "wrote no {out}"),
        ([sys.executable, "{euroc}"], "has no mav0"),
    ],
)
def test_failures_are_named(sequence: SlamSequence, words: list[str], message: str) -> None:
    with pytest.raises(EvaluationError, match=message):
        run_command(sequence, FrameClock(), words, sensor="lidar")


def test_programs_beside_this_python_are_found(
    sequence: SlamSequence, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """pip puts them there; PATH has that folder only while the environment is activated."""
    monkeypatch.setenv("PATH", os.defpath)
    out = tmp_path / "said.txt"
    words = ["sh", "-c", f"command -v {Path(sys.executable).name} > {out}; false {{out}}"]
    with pytest.raises(EvaluationError, match="ended with 1"):
        run_command(sequence, FrameClock(), words, sensor="lidar")
    assert out.read_text().strip()


def test_the_example_is_a_system(tmp_path: Path) -> None:
    pytest.importorskip("small_gicp", reason="the example aligns by small_gicp")
    from recorder.benchmark.run import BenchmarkConfig, run_benchmark

    example = Path(__file__).parents[2] / "examples" / "07_own_slam_system.py"
    data = write_dataset(tmp_path / "set", sweeps=15)
    config = BenchmarkConfig(data=data, out=tmp_path / "out", methods=(str(example),), clouds=("raw",))
    (score,) = run_benchmark(config).scores
    assert score.failed is None
    assert score.ape_m < 0.1
