"""`carlaloc maps export` and `carlaloc evaluate --map` over a small town."""

import json
from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.drives.straight_drives import StraightDrive

from carlaloc_env.core import transforms
from carlaloc_env.core.clock import STEP_NS
from recorder.cli.main import main
from recorder.episode.episode import Episode
from recorder.evaluation.align import Similarity
from recorder.evaluation.trajectory import Trajectory
from recorder.evaluation.trajectory_files import write_tum
from recorder.laboratory.surface_cloud import SurfaceCloud, write_cloud
from recorder.writers.base import DEFAULT_EPOCH_NS

o3d = pytest.importorskip("open3d", reason="open3d is not installed")
Capture = pytest.CaptureFixture[str]


def test_a_town_exported_and_judged_as_its_own_map(
    tmp_path: Path, straight_drive: StraightDrive, capfd: Capture
) -> None:
    town = str(straight_drive.town)
    cloud_file, mesh_file = tmp_path / "cloud.ply", tmp_path / "mesh.gltf"
    words = ["maps", "export", town, "--points-per-m2", "8", "--reach", "30"]
    assert main([*words, "--cloud", str(cloud_file), "--mesh", str(mesh_file), "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    cloud = o3d.t.io.read_point_cloud(str(cloud_file))
    points = cloud.point.positions.numpy()
    assert told["points"] == len(points) > 10_000
    assert len(o3d.io.read_triangle_mesh(str(mesh_file)).triangles) == told["triangles"]
    assert main([*words, "--cloud", str(cloud_file)]) == 1
    assert "--force" in capfd.readouterr().err
    assert main(["maps", "export", town]) == 2

    timeline = Episode.load(straight_drive.episode).timeline()
    stamps = np.arange(0, timeline.end_ns + 1, STEP_NS)
    motion = timeline.ego_motion(stamps)
    truth = Trajectory(
        stamp_ns=stamps + DEFAULT_EPOCH_NS, position_m=motion.position_m, quat_xyzw=motion.quat_xyzw
    )
    # The map's frame is another one than the town's.
    own = Similarity(R=transforms.quat_to_matrix(transforms.rpy_to_quat(0.1, -0.2, 2.0)), t=np.full(3, 7.0))
    moved = points @ own.R.T + own.t
    est = SurfaceCloud(
        points_xyz_m=moved.astype(np.float32),
        normals=np.zeros_like(moved, np.float32),
        tag=np.zeros(len(moved), np.uint8),
    )
    files = [
        str(write_tum(tmp_path / "truth.tum", truth)),
        str(write_tum(tmp_path / "est.tum", own.apply(truth))),
    ]
    map_file = str(write_cloud(est, tmp_path / "est.ply"))
    words = ["evaluate", "--truth", *files, "--map", map_file, "--town", town, "--reach", "25"]
    words += ["--drive", str(straight_drive.episode), "--distances", "0.5"]
    assert main([*words, "--plot", str(tmp_path), "--json"]) == 0
    out = json.loads(capfd.readouterr().out)
    (found,) = out["maps"]
    assert found["ghosts"] == 0
    whole = found["scores"][0]
    assert (whole["part"], whole["tag"], whole["distance_m"]) == ("all", "all", 0.5)
    assert whole["accuracy_m"] < 0.01
    assert whole["precision"] > 0.999
    assert whole["recall"] > 0.95
    assert [Path(plot).name for plot in out["plots"]] == ["trajectories.png", "map_est.png"]
    assert main([*words[:4], "--drive", str(straight_drive.episode)]) == 2
    assert "go together" in capfd.readouterr().err
    late = write_tum(tmp_path / "late.tum", truth.shifted(3_600_000_000_000))
    assert main(["evaluate", "--truth", str(late), str(late), *words[4:]]) == 1
    assert "stamps lie outside" in capfd.readouterr().err
