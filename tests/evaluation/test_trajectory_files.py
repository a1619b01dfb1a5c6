"""Files of trajectories, read as evo reads them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shared_fixtures.readings.short_drive import EPOCH_NS, assert_same, drive

from carlaloc_env.core import transforms
from carlaloc_env.core.errors import EvaluationError
from recorder.dataset.trajectories import named_apart, read_trajectory
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


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        ("timestamp(s) q p v bg ba cam_imu_dt num_cam cam0_k cam0_d etc", 19),
        ("time qx qy qz qw x y z", 19),
        ("time qx qy qz qw x y z", 12),
    ],
)
def test_states_of_openvins_with_its_header_or_names_of_the_pose(
    header: str, columns: int, tmp_path: Path
) -> None:
    """Its quaternions of JPL from the world to the IMU are Hamilton's from the IMU to the world."""
    truth = drive()
    rows = np.hstack([truth.quat_xyzw, truth.position_m, np.full((60, columns - 8), 0.3)])
    lines = [
        f"{stamp / 1e9:.5f} {' '.join(map(repr, row.tolist()))} "
        for stamp, row in zip(truth.stamp_ns.tolist(), rows, strict=True)
    ]
    (tmp_path / "state.txt").write_text("\n".join([f"# {header}", *lines]))
    assert_same(read_trajectory(tmp_path / "state.txt"), truth)


def test_numbers_of_frames_are_named_and_get_their_times(tmp_path: Path) -> None:
    """KISS-ICP writes them in place of times where a data set has none."""
    truth = drive()
    rows = np.column_stack([np.arange(60), truth.position_m, truth.quat_xyzw])
    np.savetxt(tmp_path / "kiss_tum.txt", rows, fmt="%.12f")
    with pytest.raises(EvaluationError, match="'kiss_tum' are numbers of frames; give --times"):
        evaluate(truth, read_trajectory(tmp_path / "kiss_tum.txt"))
    times = "\n".join(f"{stamp // 10**9}.{stamp % 10**9:09d}" for stamp in truth.stamp_ns.tolist())
    (tmp_path / "stamps.txt").write_text(times)
    assert_same(read_trajectory(tmp_path / "kiss_tum.txt", times=tmp_path / "stamps.txt"), truth)


@pytest.mark.parametrize("data", ["ascii", "binary"])
def test_poses_of_lio_sam_in_a_cloud(data: str, tmp_path: Path) -> None:
    """`pcl::getTransformation`: Rz(yaw) Ry(pitch) Rx(roll), in single precision beside a double time."""
    truth = drive()
    turns = Rotation.from_quat(truth.quat_xyzw).as_euler("xyz")
    names = ("x", "y", "z", "intensity", "roll", "pitch", "yaw", "time")
    rows = np.zeros(60, [(name, "<f8" if name == "time" else "<f4") for name in names])
    columns = [*truth.position_m.T, np.arange(60), *turns.T, truth.stamp_ns / 1e9]
    for name, column in zip(names, columns, strict=True):
        rows[name] = column
    head = (
        f"# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS {' '.join(names)}\n"
        f"SIZE 4 4 4 4 4 4 4 8\nTYPE F F F F F F F F\nCOUNT 1 1 1 1 1 1 1 1\nWIDTH 60\nHEIGHT 1\n"
        f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 60\nDATA {data}\n"
    ).encode()
    text = "\n".join(" ".join(f"{value:.9f}" for value in row) for row in rows.tolist()).encode()
    content = head + (rows.tobytes() if data == "binary" else text)
    (tmp_path / "poses.pcd").write_bytes(content)
    read = read_trajectory(tmp_path / "poses.pcd")
    np.testing.assert_allclose(read.stamp_ns, truth.stamp_ns, rtol=0, atol=300)
    assert_same(replace(read, stamp_ns=truth.stamp_ns), truth, atol=2e-6)
    (tmp_path / "cloud.pcd").write_bytes(content.replace(b"roll pitch yaw time", b"a b c d"))
    with pytest.raises(EvaluationError, match="a cloud of points with x, y, z, intensity, a"):
        read_trajectory(tmp_path / "cloud.pcd")


def test_files_of_one_name_are_told_apart_by_as_much_of_their_paths_as_that_needs() -> None:
    paths = [Path(text) for text in ("a/x/traj.tum", "b/x/traj.tum", "other.tum", "b/traj.tum", "b/traj.csv")]
    names = [one.name for one in named_apart(paths, [drive()] * 5)]
    assert names == ["a/x/traj", "b/x/traj", "other", "b/traj", "traj.csv"]
