"""Faults under a replay: killed at any moment, and a disk that fills up at any place."""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from shared_fixtures.processes.small_disks import small_disk

from recorder.dataset.checksums import checksums, read_checksums
from recorder.drive.record import RecordConfig, record

KILLS, DISKS = 50, 20
RIG = """\
name: small
sensors:
- {kind: lidar, name: lidar, columns: 200, outputs: [cloud]}
- {kind: imu}
- kind: camera
  name: front
  rate_hz: 10
  pinhole: {width_px: 160, height_px: 90, fx_px: 80, fy_px: 80, cx_px: 80, cy_px: 45}
  outputs: [rgb]
"""


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory, straight_map: Path) -> Path:
    """Two seconds among a few others, and beside it a rig and the map, which is read in a moment."""
    folder = tmp_path_factory.mktemp("faults")
    town, out = folder / "straight.xodr", folder / "drive.mcap"
    shutil.copy(straight_map, town)
    record(
        RecordConfig(map=str(town), out=out, duration_s=2.0, seed=5, traffic="dynamic,vehicles=5,walkers=0")
    )
    (folder / "rig.yaml").write_text(RIG)
    return out


def _command(drive: Path, out: Path) -> list[str]:
    town, rig = drive.with_name("straight.xodr"), drive.with_name("rig.yaml")
    return [
        sys.executable, "-m", "recorder.cli.main", "replay", str(drive), "--out", str(out),
        "--map", str(town), "--rig", str(rig),
        "--traffic", "static,dynamic", "--weather", "ClearNoon,FoggyNoon",
    ]  # fmt: skip


@pytest.fixture(scope="module")
def whole(drive: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, str], float, int]:
    """An undisturbed replay: checksums of all files, its time [s] and its size [bytes]."""
    out = tmp_path_factory.mktemp("whole") / "data"
    subprocess.run(_command(drive, out), check=True, capture_output=True)
    start = time.monotonic()
    shutil.rmtree(out)
    subprocess.run(_command(drive, out), check=True, capture_output=True)
    took_s = time.monotonic() - start
    return checksums(out), took_s, sum(path.stat().st_size for path in out.rglob("*"))


def _final_files(out: Path) -> dict[str, str]:
    """Checksums of what stands under a final name; anything else a name with a dot announces."""
    return checksums(out) if out.exists() else {}


@pytest.mark.soak
@pytest.mark.timeout(7200)
def test_killed_at_random_moments(
    drive: Path,
    whole: tuple[dict[str, str], float, int],
    tmp_path: Path,
    record_property: Callable[[str, object], None],
) -> None:
    """After SIGKILL nothing stands half-written under a final name; the same command then finishes."""
    sums, took_s, _ = whole
    rng = random.Random(7)
    for trial in range(KILLS):
        out = tmp_path / str(trial)
        child = subprocess.Popen(
            _command(drive, out), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        )
        time.sleep(rng.uniform(0.3, 1.1) * took_s)
        os.killpg(child.pid, signal.SIGKILL)
        child.wait()
        wrong = [name for name, digest in _final_files(out).items() if sums.get(name) != digest]
        assert not wrong, f"trial {trial}: half-written {wrong}"
        again = subprocess.run(_command(drive, out), capture_output=True, text=True, check=False)
        if again.returncode:
            # Killed after its last rename: then everything is there, and the command says so.
            assert "exist" in again.stderr
            assert read_checksums(out) == sums
        assert _final_files(out) == sums, f"trial {trial}"
        shutil.rmtree(out)
    record_property("what", "SIGKILL at a random moment of a replay; the same command then finishes it")
    record_property("inputs", KILLS)


@pytest.mark.soak
@pytest.mark.timeout(7200)
def test_disk_fills_up_at_random_places(
    drive: Path,
    whole: tuple[dict[str, str], float, int],
    tmp_path: Path,
    record_property: Callable[[str, object], None],
) -> None:
    """A full disk is one line, and leaves nothing half-written."""
    sums, _, size = whole
    rng = random.Random(8)
    for trial in range(DISKS):
        with small_disk(tmp_path / "disk", round(size * rng.uniform(0.02, 0.95))) as folder:
            out = folder / "data"
            ended = subprocess.run(_command(drive, out), capture_output=True, text=True, check=False)
            assert ended.returncode == 1, ended.stderr
            lines = [line for line in ended.stderr.splitlines() if not line.startswith("replaying: ")]
            assert len(lines) == 1, ended.stderr
            assert lines[0].startswith("carlaloc replay: ")
            wrong = [name for name, digest in _final_files(out).items() if sums.get(name) != digest]
            assert not wrong, f"trial {trial}: half-written {wrong}"
    record_property("what", "disk that fills up at a random place of a replay")
    record_property("inputs", DISKS)
