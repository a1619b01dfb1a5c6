"""Replays that are really killed: what they leave, and that the same command goes on to the same bytes."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from shared_fixtures.drives.straight_drives import StraightDrive

from carlaloc_env.core.errors import WriterError
from recorder.dataset.checksums import checksums
from recorder.replaying import working_folder
from recorder.replaying.replay import replay
from recorder.replaying.working_folder import FOLDER, UNITS

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="signals and locks as on Linux")


RIG = """\
name: slow
sensors:
- {kind: lidar, name: lidar, columns: 1800, mount: {position_m: [0.0, 0.0, 1.8]}}
- {kind: imu}
"""
"""Its units take long enough to be ended in the middle; pictures would take longer to begin than to draw."""


def command(drive: StraightDrive, out: Path, workers: int = 2) -> list[str]:
    words = ("--format", "rosbag1,euroc", "--unit", "0.25", "--workers", str(workers))
    rig = drive.rig.with_name("lidar.yaml")
    rig.write_text(RIG)
    return drive.command(out, *words, rig=rig)


def start(words: list[str], out: Path, units: int) -> subprocess.Popen[str]:
    """A replay that has finished some units and has others in hand."""
    child = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    end = time.monotonic() + 600.0
    while len(whole_units(out)) < units or not list(out.glob(f"{FOLDER}/{UNITS}/*.part")):
        assert child.poll() is None, child.communicate()
        assert time.monotonic() < end
        time.sleep(0.01)
    return child


def whole_units(out: Path) -> list[Path]:
    return [path for path in out.glob(f"{FOLDER}/{UNITS}/*") if path.is_dir() and "." not in path.name]


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


@pytest.fixture(scope="module")
def whole(straight_drive: StraightDrive, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Checksums of a replay that nobody disturbs."""
    out = tmp_path_factory.mktemp("whole") / "data"
    done = subprocess.run(command(straight_drive, out), capture_output=True, text=True, check=False)
    if "OpenGL" in done.stderr:
        pytest.skip(done.stderr)
    assert done.returncode == 0, done.stderr
    return checksums(out)


def finish(drive: StraightDrive, out: Path, whole: dict[str, str]) -> str:
    """Run the same command again; it must go on, and end as if nothing had happened."""
    done = subprocess.run(command(drive, out), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert checksums(out) == whole
    assert sorted(path.name for path in out.iterdir()) == ["SHA256SUMS", "dataset.yaml", "straight"]
    return done.stderr


@pytest.mark.parametrize(
    ("number", "workers"),
    [
        (signal.SIGINT, 2),
        *(pytest.param(*case, marks=pytest.mark.soak) for case in ((15, 1), (15, 2), (2, 1))),
    ],
)
def test_asked_to_end_it_says_how_to_go_on_and_killed_it_goes_on(
    number: int, workers: int, straight_drive: StraightDrive, whole: dict[str, str], tmp_path: Path
) -> None:
    out = tmp_path / "data"
    child = start(command(straight_drive, out, workers), out, 1)
    child.send_signal(number)
    stdout, stderr = child.communicate(timeout=600)
    assert child.returncode == 1
    (line,) = [line for line in stderr.splitlines() if line.startswith("carlaloc replay: ")]
    assert line.startswith("carlaloc replay: interrupted; ")
    assert line.endswith(" the same command resumes from there")
    assert stdout == ""
    assert [path.name for path in out.iterdir()] == [FOLDER]
    assert not list(out.rglob("*.part"))
    assert not processes_in(out)
    assert whole_units(out)
    # Gone on with, it is killed.
    child = start(command(straight_drive, out), out, 2)
    child.kill()
    assert "units that are already whole" in child.communicate(timeout=600)[1]
    end = time.monotonic() + 600.0
    while processes_in(out):
        assert time.monotonic() < end, "workers outlive the killed replay"
        time.sleep(0.1)
    assert [path.name for path in out.iterdir()] == [FOLDER]
    kept = whole_units(out)
    assert len(kept) >= 2
    # A bit of one of them flips while nobody looks: that one is made again.
    spool = kept[0] / "shared.spool"
    data = bytearray(spool.read_bytes())
    data[len(data) // 2] ^= 1
    spool.write_bytes(data)
    said = finish(straight_drive, out, whole)
    assert f"resuming with {len(kept) - 1} of 8 units" in said


def test_interrupted_before_anything_is_whole_it_leaves_nothing(
    straight_drive: StraightDrive, tmp_path: Path
) -> None:
    out = tmp_path / "deep" / "data"
    child = start([*command(straight_drive, out), "--unit", "2"], out, 0)
    child.send_signal(signal.SIGINT)
    _, stderr = child.communicate(timeout=600)
    assert "interrupted; nothing unfinished was left under a final name" in stderr
    assert list(tmp_path.iterdir()) == []


class _Killed(BaseException):
    """Stands for a kill between two renames."""


@pytest.mark.parametrize("renames", [0, 1, 2, 3])
def test_a_whole_run_is_finished_by_the_next_one(
    renames: int, straight_drive: StraightDrive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cut off after any number of renames, the same command ends with the same dataset."""
    replay(straight_drive.config(tmp_path / "whole"))
    left = renames
    real = Path.rename

    def rename(self: Path, target: Path) -> Path:
        nonlocal left
        if FOLDER in self.parts and FOLDER not in Path(target).parts:
            if left == 0:
                raise _Killed
            left -= 1
        return real(self, target)

    cut = straight_drive.config(tmp_path / "cut")
    if renames < 3:
        monkeypatch.setattr(Path, "rename", rename)
    else:
        monkeypatch.setattr(working_folder, "list_drive", lambda *_: (_ for _ in ()).throw(_Killed))
    with pytest.raises(_Killed):
        replay(cut)
    monkeypatch.undo()
    result = replay(cut)
    assert result.samples["imu"] == 400
    assert checksums(tmp_path / "cut") == checksums(tmp_path / "whole")
    assert not (tmp_path / "cut" / FOLDER).exists()
    with pytest.raises(WriterError, match="exists"):
        replay(cut)
