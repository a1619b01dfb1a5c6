"""Whose unfinished work it is: another configuration and a second run at once are refused in one line."""

import os
import platform
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from shared_fixtures.drives.straight_drives import StraightDrive
from shared_fixtures.processes.small_disks import small_disk

from carlaloc_env.core.errors import WriterError
from carlaloc_env.core.files.file_locks import _boot
from recorder.benchmark.plan import find_sequences
from recorder.dataset.checksums import checksums
from recorder.dataset.layout import CHECKSUMS
from recorder.replaying import cost, run
from recorder.replaying import plan as replay_plan
from recorder.replaying.code_digest import code_digest
from recorder.replaying.replay import ReplayConfig, replay
from recorder.replaying.working_folder import FOLDER, OWNER, WorkingFolder
from recorder.verification.verify import verify


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def left_unfinished(config: ReplayConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run whose disk is full when the first sequence is to be assembled."""

    def fail(job: Any, report: Any) -> None:
        raise WriterError("cannot write here: No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(run, "assemble", fail)
        with pytest.raises(WriterError, match=r"No space .*; 4 parts are whole, and the same command"):
            replay(config)


CHANGES: tuple[tuple[dict[str, Any], str], ...] = (
    ({"weathers": ("FoggyNoon",)}, "set of conditions"),
    ({"traffic": ("static",)}, "set of conditions"),
    ({"formats": ("rosbag1",)}, "set of formats"),
    ({"seed": 9}, "seed"),
    ({"duration_s": 1.0}, "stretch"),
    ({"rig": "state"}, "rig"),
    ({"unit_s": 1.0}, "length of units"),
)
"""What another configuration has other than the one that was left unfinished, and its name."""


def test_another_configuration_is_refused_and_nothing_touched(
    straight_drive: StraightDrive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = straight_drive.config(tmp_path / "data")
    left_unfinished(config, monkeypatch)
    before = files(tmp_path)
    for change, what in CHANGES:
        with pytest.raises(WriterError, match=f"unfinished run with another {what}.*; finish it") as failure:
            replay(replace(config, **change))
        assert "\n" not in str(failure.value)
        assert files(tmp_path) == before
    assert replay(config).samples["imu"] == 400


def test_other_code_does_not_go_on(
    straight_drive: StraightDrive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = straight_drive.config(tmp_path / "data")
    left_unfinished(config, monkeypatch)
    assert len(code_digest()) == 64
    monkeypatch.setattr(replay_plan, "code_digest", lambda: "other")
    with pytest.raises(WriterError, match="another version of CarlaLoc"):
        replay(config)


@pytest.mark.skipif(sys.platform != "linux", reason="locks as on Linux")
def test_two_runs_at_once_are_refused(straight_drive: StraightDrive, tmp_path: Path) -> None:
    out = tmp_path / "data"
    with WorkingFolder(out, "straight", {}, {"seed": "1"}) as work:
        with pytest.raises(WriterError, match=r"another run is at work in .*; wait until it has ended"):
            replay(straight_drive.config(out))
        assert work.path.is_dir()
    assert not out.exists()


_HOLDER = """
import fcntl, pathlib, sys, time; fcntl.flock = lambda *_: None
from recorder.replaying.working_folder import WorkingFolder
with WorkingFolder(pathlib.Path(sys.argv[1]), "straight", {}, {"seed": "1"}):
    print("held", flush=True); time.sleep(600)
"""
"""A run on a disk whose locks exclude nobody."""


@pytest.mark.skipif(sys.platform != "linux", reason="locks as on Linux")
def test_where_locks_exclude_nobody_runs_are_told_apart_by_host_and_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As over NFS: a live run is left alone, a killed one is resumed, and one elsewhere cannot be asked."""
    monkeypatch.setattr("fcntl.flock", lambda *_: None)
    out = tmp_path / "data"
    work = WorkingFolder(out, "straight", {}, {"seed": "1"})
    command = [sys.executable, "-c", _HOLDER, str(out)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        holder = f"process {process.pid} on host {platform.node()}"
        refused = rf"another run is at work in .*: {holder}; wait until it"
        with pytest.raises(WriterError, match=refused), work:
            pass
        assert (work.path / OWNER).is_symlink()
        process.kill()
    with work:
        assert (work.path / OWNER).is_symlink()
        with pytest.raises(WriterError, match=f"process {os.getpid()} on host"):
            WorkingFolder(out, "straight", {}, {"seed": "1"}).__enter__()
    work.path.mkdir(parents=True)
    (work.path / OWNER).symlink_to("elsewhere 0 1")
    cure = r"process 1 on host elsewhere \(if it has ended there, delete .*owner\)"
    with pytest.raises(WriterError, match=cure), work:
        pass
    (work.path / OWNER).unlink()
    with work:
        assert work.units_dir.is_dir()


def test_where_locks_hold_a_killed_run_of_another_container_is_resumed(tmp_path: Path) -> None:
    """Containers of one machine differ in their names, and all have a process of the same number."""
    work = WorkingFolder(tmp_path / "data", "straight", {}, {"seed": "1"})
    work.path.mkdir(parents=True)
    (work.path / OWNER).symlink_to(f"another {_boot()} {os.getpid()}")
    with work:
        assert work.units_dir.is_dir()


def test_a_full_disk_is_one_line_and_with_room_the_same_command_goes_on(
    straight_drive: StraightDrive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Else it would be refused before it begins.
    monkeypatch.setattr(cost, "SIZE_ERROR", 1.0)
    replay(straight_drive.config(tmp_path / "whole"))
    whole = checksums(tmp_path / "whole")
    size = sum(len(data) for data in files(tmp_path / "whole").values())
    with small_disk(tmp_path / "disk", round(1.4 * size)) as disk:
        config = straight_drive.config(disk / "data")
        ballast = disk / "ballast"
        ballast.write_bytes(bytes(size * 6 // 10))
        with pytest.raises(WriterError, match=r"No space left on device|are free in") as failure:
            replay(config)
        assert "\n" not in str(failure.value)
        assert not [path for path in (disk / "data").rglob("*") if ".part" in path.name]
        ballast.unlink()
        kept = [path for path in (disk / "data" / FOLDER / "units").iterdir() if path.is_dir()]
        assert kept
        # Spools and files together need more than this disk has: a larger one takes over.
        shutil.copytree(disk / "data" / FOLDER, tmp_path / "data" / FOLDER)
    replay(replace(config, out=tmp_path / "data"))
    assert checksums(tmp_path / "data") == whole


def test_a_failed_replay_leaves_no_folder(straight_drive: StraightDrive, tmp_path: Path) -> None:
    """EuRoC needs an IMU: the rig has none, and the error comes when writing begins."""
    rig = tmp_path / "no_imu.yaml"
    rig.write_text("name: none\nsensors:\n- {kind: speed}\n")
    with pytest.raises(WriterError, match="IMU"):
        replay(straight_drive.config(tmp_path / "a" / "b", rig=str(rig), formats=("euroc",)))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["no_imu.yaml"]


def test_a_drive_may_lie_on_another_disk_behind_a_link(straight_drive: StraightDrive, tmp_path: Path) -> None:
    """It is found and verified, and another replay adds to it and to the checksums, as without the link."""
    config = replace(straight_drive.config(tmp_path / "data"), formats=("euroc",))
    plain = replace(config, out=tmp_path / "plain")
    for one in (config, plain):
        replay(one)
    elsewhere = Path(tempfile.mkdtemp(dir="/dev/shm" if Path("/dev/shm").is_dir() else tmp_path))
    try:
        shutil.move(config.out / "straight", elsewhere)
        (config.out / "straight").symlink_to(elsewhere / "straight")
        (config.out / "straight" / "round").symlink_to(config.out)
        assert verify(config.out).findings == ()
        for one in (config, plain):
            replay(replace(one, traffic=("static",)))
        assert verify(config.out).findings == ()
        ours, theirs = ([s.key for s in find_sequences(one.out)] for one in (config, plain))
        assert (len(ours), ours) == (2, theirs)
        assert (config.out / CHECKSUMS).read_bytes() == (plain.out / CHECKSUMS).read_bytes()
    finally:
        shutil.rmtree(elsewhere)
