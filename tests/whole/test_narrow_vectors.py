"""A replay without wide vectors and fused multiply-adds gives the bytes of one with them."""

import os
import subprocess
from pathlib import Path

import pytest
from shared_fixtures.drives.straight_drives import StraightDrive
from shared_fixtures.processes.narrow_vectors import narrow_environment

from recorder.dataset.checksums import checksums

RIG = """\
name: rays
sensors:
- {kind: lidar, name: lidar, columns: 500, outputs: [cloud, semantic], mount: {position_m: [0.0, 0.0, 1.8]}}
- {kind: radar, name: front, mount: {position_m: [2.3, 0.0, 0.7]}}
- {kind: imu}
- {kind: gnss}
"""
WORDS = ["--format", "raw", "--topics", "full", "--weather", "ClearNoon,FoggyNoon,RainyNight", "--no-preview"]


@pytest.mark.soak
def test_truth_imu_gnss_traffic_lidar_radar_and_town(straight_drive: StraightDrive, tmp_path: Path) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text(RIG)
    made = {}
    for name, switches in (("wide", {}), ("narrow", narrow_environment())):
        out = tmp_path / name
        caches = {"CARLALOC_CACHE": str(out / "cache"), "NUMBA_CACHE_DIR": str(tmp_path / f"{name}_code")}
        command = straight_drive.command(out / "data", *WORDS, rig=rig)
        subprocess.run(command, env={**os.environ, **caches, **switches}, check=True)
        made[name] = checksums(out)
    assert {Path(path).suffix for path in made["wide"]} >= {".town", ".lanes", ".ply", ".npz", ".tum"}
    assert made["wide"] == made["narrow"]
