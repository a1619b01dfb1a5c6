"""Files of trajectories, read as evo reads them."""

from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.readings.short_drive import EPOCH_NS, assert_same, drive

from carlaloc_env.core import transforms
from carlaloc_env.core.errors import EvaluationError
from recorder.dataset.trajectories import read_trajectory
from recorder.evaluation.evaluate import evaluate


def test_kitti_as_evo_reads_it(tmp_path: Path) -> None:
    evo = pytest.importorskip("evo.tools.file_interface")
    truth = drive()
    rows = np.concatenate([transforms.quat_to_matrix(truth.quat_xyzw), truth.position_m[:, :, None]], axis=2)
    np.savetxt(tmp_path / "00.txt", rows.reshape(-1, 12), fmt="%.12e")
    with pytest.raises(EvaluationError, match="--times"):
        read_trajectory(tmp_path / "00.txt")
    (tmp_path / "times.txt").write_text(
        "\n".join(f"{(t - EPOCH_NS) / 1e9:.9f}" for t in truth.stamp_ns.tolist())
    )
    read = read_trajectory(tmp_path / "00.txt").shifted(EPOCH_NS)
    assert_same(read, truth)
    theirs = evo.read_kitti_poses_file(str(tmp_path / "00.txt"))
    np.testing.assert_allclose(read.position_m, theirs.positions_xyz, atol=1e-9)
    wxyz = np.abs(np.sum(read.quat_xyzw[:, [3, 0, 1, 2]] * theirs.orientations_quat_wxyz, axis=1))
    np.testing.assert_allclose(wxyz, 1.0, atol=1e-9)
    (tmp_path / "short.txt").write_text("0.0\n0.1\n")
    with pytest.raises(EvaluationError, match="60 poses"):
        read_trajectory(tmp_path / "00.txt", times=tmp_path / "short.txt")


def test_euroc_table_as_evo_reads_it(tmp_path: Path) -> None:
    evo = pytest.importorskip("evo.tools.file_interface")
    truth = drive()
    rows = [
        f"{stamp},{','.join(map(repr, [*p, *np.roll(q, 1).tolist(), *[0.0] * 9]))}"
        for stamp, p, q in zip(
            truth.stamp_ns.tolist(), truth.position_m.tolist(), truth.quat_xyzw.tolist(), strict=True
        )
    ]
    (tmp_path / "data.csv").write_text("#timestamp, p_RS_R_x [m], ...\n" + "\n".join(rows) + "\n")
    read = read_trajectory(tmp_path / "data.csv")
    assert_same(read, truth)
    theirs = evo.read_euroc_csv_trajectory(str(tmp_path / "data.csv"))
    np.testing.assert_allclose(read.position_m, theirs.positions_xyz)
    np.testing.assert_allclose(read.quat_xyzw[:, [3, 0, 1, 2]], theirs.orientations_quat_wxyz, atol=1e-12)


@pytest.mark.parametrize("first", [0, 1])
def test_complete_estimate_covers_all(first: int) -> None:
    """A pose at the beginning or at the end of each of 60 sweeps, under a truth of 200 Hz."""
    truth = drive(1200, 5_000_000)
    every = np.arange(20 * first, 1200, 20)
    result = evaluate(truth, truth.take(every))
    assert result.coverage == 1.0
    half = evaluate(truth, truth.take(every[: len(every) // 2]))
    assert half.coverage == pytest.approx(0.5, abs=0.01)
