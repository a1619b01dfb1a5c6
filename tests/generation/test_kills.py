"""Replays that are really killed: what they leave, and what the same command does then."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

from carlaloc_env.core.errors import WriterError
from recorder.generation import working_folder
from recorder.generation.dataset_manifest import checksums
from recorder.generation.replay import ReplayConfig, replay
from recorder.generation.working_folder import FOLDER, settle_killed_runs

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="signals and locks as on Linux")


def command(drive: Path, out: Path) -> list[str]:
    return [
        sys.executable, "-m", "recorder.cli.main", "replay", str(drive), "--out", str(out), "--rig", "lidar",
        "--format", "rosbag1", "--traffic", "static,dynamic",
    ]  # fmt: skip


def start(drive: Path, out: Path) -> subprocess.Popen[str]:
    """A replay that has begun to write its bags."""
    child = subprocess.Popen(command(drive, out), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    end = time.monotonic() + 240.0
    while not list(out.glob(f"{FOLDER}/*/*/.*.part/.*.part")):
        assert child.poll() is None, child.communicate()
        assert time.monotonic() < end
        time.sleep(0.02)
    return child


def processes_in(folder: Path) -> list[str]:
    """Processes that hold a file of a folder open."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/fd/*"):
        try:
            if entry.readlink().is_relative_to(folder):
                found.append(entry.parts[2])
        except OSError:
            continue
    return found


@pytest.mark.timeout(900)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_asked_to_end_it_leaves_nothing(number: signal.Signals, short_drive: Path, tmp_path: Path) -> None:
    out = tmp_path / "deep" / "data"
    child = start(short_drive, out)
    child.send_signal(number)
    stdout, stderr = child.communicate(timeout=60)
    assert child.returncode == 1
    lines = [line for line in stderr.splitlines() if line.startswith("carlaloc replay: ")]
    assert lines == ["carlaloc replay: interrupted; nothing unfinished was left under a final name"]
    assert stdout == ""
    assert list(tmp_path.iterdir()) == []


@pytest.mark.timeout(900)
def test_killed_it_leaves_nothing_under_a_final_name_and_can_be_done_again(
    short_drive: Path, tmp_path: Path
) -> None:
    out = tmp_path / "data"
    child = start(short_drive, out)
    child.kill()
    child.communicate(timeout=60)
    end = time.monotonic() + 20.0
    while processes_in(out):
        assert time.monotonic() < end, "workers outlive the killed replay"
        time.sleep(0.1)
    assert [path.name for path in out.iterdir()] == [FOLDER]
    done = subprocess.run(command(short_drive, out), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "removed what a replay that was killed left" in done.stderr
    assert sorted(path.name for path in out.iterdir()) == ["Town03", "dataset.yaml"]
    assert yaml.safe_load((out / "dataset.yaml").read_text())["sha256"] == checksums(out)


class _Killed(BaseException):
    """Stands for a kill between two renames."""


@pytest.mark.parametrize("renames", [0, 1, 2, 3])
def test_a_whole_run_is_finished_by_the_next_one(
    renames: int, short_drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cut off after any number of renames, the same command ends with the same dataset."""
    config = ReplayConfig(
        episode=short_drive, out=tmp_path / "whole", rig="state", formats=("rosbag1",), duration_s=0.5
    )
    replay(config)
    left = renames
    real = Path.rename

    def rename(self: Path, target: Path) -> Path:
        nonlocal left
        if FOLDER in self.parts and FOLDER not in Path(target).parts:
            if left == 0:
                raise _Killed
            left -= 1
        return real(self, target)

    cut = ReplayConfig(
        episode=short_drive, out=tmp_path / "cut", rig="state", formats=("rosbag1",), duration_s=0.5
    )
    if renames < 3:
        monkeypatch.setattr(Path, "rename", rename)
    else:
        monkeypatch.setattr(working_folder, "write_record", lambda *_: (_ for _ in ()).throw(_Killed))
    with pytest.raises(_Killed):
        replay(cut)
    monkeypatch.undo()
    result = replay(cut)
    assert result.samples["imu"] == 100
    assert checksums(tmp_path / "cut") == checksums(tmp_path / "whole")
    assert not (tmp_path / "cut" / FOLDER).exists()
    with pytest.raises(WriterError, match="exists"):
        replay(cut)


def test_a_run_that_lives_is_left_alone(short_drive: Path, tmp_path: Path) -> None:
    out = tmp_path / "data"
    with working_folder.WorkingFolder(out, "Town03", {}, "other") as work:
        assert settle_killed_runs(out) == []
        assert work.path.is_dir()
    assert not out.exists()


def test_a_failed_replay_leaves_no_folder(short_drive: Path, tmp_path: Path) -> None:
    """EuRoC needs an IMU: the rig has none, and the error comes when writing begins."""
    rig = tmp_path / "no_imu.yaml"
    rig.write_text("name: none\nsensors:\n- {kind: speed}\n")
    config = ReplayConfig(episode=short_drive, out=tmp_path / "a" / "b", rig=str(rig), formats=("euroc",))
    with pytest.raises(WriterError, match="IMU"):
        replay(config)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["no_imu.yaml"]
