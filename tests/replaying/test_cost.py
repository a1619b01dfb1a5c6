"""Size and time of a replay before it begins: near those of the files, refused where no disk holds them."""

import shutil
from pathlib import Path

import pytest
from shared_fixtures.drives.straight_drives import StraightDrive

from carlaloc_env.core.errors import WriterError
from recorder.cli.commands import record
from recorder.cli.main import main
from recorder.replaying.cost import (
    SIZE_ERROR,
    ReplayCost,
    replay_cost,
    size_of,
)
from recorder.replaying.options import ReplayOptions
from recorder.replaying.plan import plan_replay
from recorder.replaying.replay import replay
from recorder.writers.stream_sizes import Stretch

FULL_RIG = """\
name: large
sensors:
- kind: lidar
  elevations_deg: [-30, -26, -22, -18, -14, -10, -8, -6]
  mount: {position_m: [0.0, 0.0, 1.8]}
- kind: camera
  name: left
  mount: {position_m: [0.3, 0.2, 1.6], axes: optical}
  pinhole: {width_px: 640, height_px: 360, fx_px: 320, fy_px: 320, cx_px: 320, cy_px: 180}
- {kind: imu}
"""
GB = 1e9


@pytest.mark.parametrize("topics", ["standard", "slam"])
def test_the_announced_size_is_that_of_the_files(
    topics: str, straight_drive: StraightDrive, tmp_path: Path
) -> None:
    """Two weathers of a camera and a LiDAR whose rays meet the ground, to the error that the line names."""
    (tmp_path / "rig.yaml").write_text(FULL_RIG)
    config = straight_drive.config(
        tmp_path / "data", rig=str(tmp_path / "rig.yaml"), topics=topics, weathers=("ClearNoon", "FoggyNoon"),
        formats=("rosbag1",), duration_s=0.4, camera_duration_s=0.2, preview=False,
    )  # fmt: skip
    told: list[ReplayCost] = []
    found = replay(config, announce=told.append)
    size = sum(size_of(folder) for folder in found.sequences)
    assert size > 5e6
    assert told[0].written_bytes == pytest.approx(size, rel=SIZE_ERROR)


def test_sizes_of_the_docs_are_estimated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An hour and the 42 sequences by topics, as docs/formats.md and docs/performance.md measured them."""
    monkeypatch.setenv("CARLALOC_CACHE", str(tmp_path))  # no slowness of this machine
    for topics, name, hour_gb in (
        ("compact", "rosbag2", 17),
        ("compact_full", "rosbag2", 35),
        ("standard", "rosbag1", 1240),
    ):
        options = ReplayOptions(topics=topics, formats=(name,))
        assert replay_cost(options, [Stretch(3600.0, 3600.0)], 2).written_bytes == pytest.approx(
            hour_gb * GB, rel=0.3
        )
    six = {"weathers": ("ClearNoon", "FoggyNoon", "RainyNight"), "traffic": ("static", "dynamic")}
    slam = replay_cost(
        ReplayOptions(topics="slam", formats=("rosbag2",), **six), [Stretch(1260.0, 1260.0)], 2
    )
    assert slam.written_bytes == pytest.approx(318 * GB, rel=0.3)
    assert slam.seconds == pytest.approx(5.5 * 3600, rel=0.5)
    four = ReplayOptions(weathers=("ClearNoon", "FoggyNoon"), traffic=("static", "dynamic"))
    readme = replay_cost(four, [Stretch(60.0, 2.0)], 2)
    assert readme.written_bytes == pytest.approx(10.8 * GB, rel=0.3)
    assert 100 < readme.seconds < 400


def test_what_no_disk_holds_is_refused_in_one_line_before_it_begins(
    straight_drive: StraightDrive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """Nothing is left; with room for it, the line comes first."""
    words = ["replay", str(straight_drive.episode), "--out", str(tmp_path / "data"), "--map"]
    words += [str(straight_drive.town), "--rig", str(straight_drive.state_rig), "--format", "rosbag1"]
    with monkeypatch.context() as patch:
        full = shutil.disk_usage("/")._replace(free=500_000)
        patch.setattr(shutil, "disk_usage", lambda _: full)
        assert main([*words, "--workers", "1"]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "(±10%), and 0.0 GB are free" in line
    assert not (tmp_path / "data").exists()
    assert main([*words, "--workers", "1"]) == 0
    first = capsys.readouterr().err.splitlines()[0]
    assert first.startswith("about 0.00 GB and at times 0.00 GB more (±10%); about ")


def test_an_interrupted_replay_needs_the_rest_alone(
    straight_drive: StraightDrive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What lies in the working folder counts as room."""
    cost = plan_replay(straight_drive.config(tmp_path / "data")).cost()
    needed = round(cost.written_bytes + cost.spooled_bytes)
    half = shutil.disk_usage("/")._replace(free=needed // 2)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: half)
    with pytest.raises(WriterError, match="make room"):
        cost.check(tmp_path)
    cost.check(tmp_path, kept_bytes=needed // 2)


def test_a_drive_that_no_disk_holds_is_refused_before_it_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    full = shutil.disk_usage("/")._replace(free=100_000)
    monkeypatch.setattr(record, "disk_usage", lambda _: full)
    assert main(["record", "--map", "Town03", "--duration", "60", "--out", str(tmp_path / "a.mcap")]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "60 s of driving need about 5 MB (within a factor of 2), and 0 MB are free" in line
    assert not list(tmp_path.iterdir())
