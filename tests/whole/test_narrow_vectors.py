"""A replay without wide vectors and fused multiply-adds gives the bytes of one with them."""

import os
import subprocess
from pathlib import Path

import pytest
from shared_fixtures.drives.straight_drives import StraightDrive

from benchmarks.narrow_vectors import narrow_environment
from recorder.dataset.layout import checksums

pytestmark = pytest.mark.soak

RIG = """\
name: rays
sensors:
- {kind: lidar, name: lidar, columns: 500, outputs: [cloud, semantic], mount: {position_m: [0.0, 0.0, 1.8]}}
- {kind: radar, name: front, mount: {position_m: [2.3, 0.0, 0.7]}}
- {kind: imu}
- {kind: gnss}
"""


def test_truth_imu_gnss_traffic_lidar_radar_and_town(straight_drive: StraightDrive, tmp_path: Path) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text(RIG)
    made = {}
    for name, switches in (("wide", {}), ("narrow", narrow_environment())):
        caches = {
            "CARLALOC_CACHE": str(tmp_path / name / "cache"),
            "NUMBA_CACHE_DIR": str(tmp_path / f"{name}_code"),
        }
        words = (
            "--format",
            "raw",
            "--topics",
            "full",
            "--weather",
            "ClearNoon,FoggyNoon,RainyNight",
            "--no-preview",
        )
        subprocess.run(
            straight_drive.command(tmp_path / name / "data", *words, rig=rig),
            env={**os.environ, **caches, **switches},
            check=True,
        )
        made[name] = checksums(tmp_path / name)
    assert {Path(path).suffix for path in made["wide"]} >= {".town", ".lanes", ".ply", ".npz", ".tum"}
    assert made["wide"] == made["narrow"]
