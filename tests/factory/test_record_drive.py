"""Standard drives for a benchmark: each is recorded once, to the end of its route."""

import shutil
from pathlib import Path

import pytest

from recorder.cli.main import main
from recorder.drive.standard_drives import standard_drives
from recorder.episode.episode import Episode


def test_drives_are_recorded_once_and_to_their_ends(
    straight_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for town in ("East", "West"):
        (tmp_path / "maps" / town).mkdir(parents=True)
        shutil.copy(straight_map, tmp_path / "maps" / town / "town.xodr")
    monkeypatch.setenv("CARLALOC_MAPS", str(tmp_path / "maps"))
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "East.mcap").write_bytes(b"a drive that is kept")
    told: list[str] = []
    east, west = standard_drives(
        tmp_path / "out", lambda done, total, what: told.append(f"{done:.1f} {what}"), towns=("East", "West")
    )
    assert east.read_bytes() == b"a drive that is kept"
    drive = Episode.load(west)
    way_m = float(abs(drive.timeline().ego_motion([0, drive.timeline().end_ns]).position_m[1, 0]))
    assert drive.header.seed == 0
    assert way_m > 200.0
    assert told[0].startswith("1.0 driving through West")


def test_the_command_wants_either(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words, why in (([], "or --standard"), (["--standard"], "give --out")):
        assert main(["benchmark", *words]) == 2
        assert why in capsys.readouterr().err
