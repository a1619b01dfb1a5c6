"""Faults of data that a benchmark reports before its runs, and causes of errors that its tables name."""

from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.readings.slam_dataset import inertial, write_dataset

from recorder.benchmark.page import write_page
from recorder.benchmark.run import BenchmarkConfig, run_benchmark
from recorder.benchmark.tables import all_tables, frame_of
from recorder.dataset.reading_checks import faults_of_foreign, gravity_fault

# A system that knows the truth, in the axes of a camera.
CAMERA_AXES = """
import numpy as np
from carlaloc_env.core import transforms as tf
from recorder.evaluation.trajectory_files import read_tum
from recorder.slam.system import System

SYSTEM = System(
    name="oracle", title="Oracle", what="a test", needs=("lidar", "imu"), runner="x:run", frame="lidar"
)
R = tf.from_rotation(tf.quat_to_matrix(tf.rpy_to_quat(*np.radians([-90.0, 0.0, -90.0]))))

def run(sequence, clock):
    stamps = np.array([scan.stamp_ns for scan in sequence.scans()])
    there = read_tum(sequence.truth_file("lidar")).at(stamps)
    poses = zip(stamps, there.position_m, there.quat_xyzw)
    return [(stamp, tf.from_rotation(tf.quat_to_matrix(q), p) @ R) for stamp, p, q in poses]
"""


@pytest.mark.parametrize(
    ("factor", "words"),
    [(1.0, None), (-1.0, "gravity has the wrong sign"), (1 / 9.81, "they are in g, not in m/s²")],
)
def test_a_wrong_imu_is_named_before_the_runs(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, factor: float, words: str | None
) -> None:
    data = write_dataset(tmp_path / "set", sweeps=40, imu_factor=factor)
    (tmp_path / "oracle.py").write_text(CAMERA_AXES)
    config = BenchmarkConfig(
        data=data, out=tmp_path / "out", methods=(str(tmp_path / "oracle.py"),), clouds=("raw",)
    )
    result = run_benchmark(config)
    (score,) = result.scores
    assert score.failed is None
    assert score.time_coverage > 0.95
    assert "a constant rotation of 120.0° lies between the body frames" in score.findings
    start, line = [*caplog.messages, ""][:2]
    assert start.startswith("Box begins at 1.4 m/s, a false start")
    if words is None:
        assert line == ""
        assert "IMU" not in score.findings
    else:
        assert line.startswith("Box/ClearNoon_dynamic: IMU does not fit the truth: accelerations are")
        assert words in line
        assert words in score.findings
    table = dict(all_tables(frame_of(result.scores)))["Findings about data and estimates"]
    assert table.to_numpy().tolist() == [["Oracle", "Box", "ClearNoon dynamic", "1 of 1", score.findings]]
    assert "a constant rotation of 120.0°" in write_page(result).read_text()
    assert run_benchmark(config).scores[0].findings == score.findings


def test_gravity_of_other_bags(tmp_path: Path) -> None:
    data = write_dataset(tmp_path / "set", sweeps=10, imu_factor=-1.0)
    (bag,) = data.rglob("*.bag")
    (line,) = faults_of_foreign(bag)
    assert line.startswith(
        "accelerations of /imu/data look wrong, if its z axis points up: gravity has the wrong"
    )
    forces = {k: np.array([one.specific_force_mps2 for one in inertial(10, k)]) for k in (1.0, 0.0)}
    assert gravity_fault(forces[1.0]) is None
    assert gravity_fault(forces[0.0]) == "they lack gravity"
