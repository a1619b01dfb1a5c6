"""The whole dataset in small: planned, refused, made, kept, verified, and made again from its manifest."""

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from shared_fixtures.drives.straight_drives import StraightDrive

from carlaloc_env.core.errors import ConfigError, WriterError
from recorder import factory
from recorder.cli.main import main
from recorder.dataset.checksums import checksums, read_checksums
from recorder.dataset.manifest import DatasetManifest
from recorder.factory import DatasetConfig, make_dataset, plan_dataset
from recorder.replaying import cost
from recorder.replaying.options import ReplayOptions
from recorder.verification.verify import verify


def config_of(out: Path, episodes: Path | None) -> DatasetConfig:
    few = ReplayOptions(
        weathers=("ClearNoon", "FoggyNoon", "RainyNight"),
        traffic=("static", "dynamic"),
        rig="state",
        formats=("rosbag1",),
        workers=1,
    )
    return DatasetConfig(out=out, towns=("straight",), episodes=episodes, sample_s=1.0, replay=few)


@pytest.fixture
def config(straight_drive: StraightDrive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> DatasetConfig:
    """A second of one drive by a person, in a town of his own, under all six conditions."""
    for folder in (tmp_path / "mine", tmp_path / "maps" / "straight"):
        folder.mkdir(parents=True)
    shutil.copy(straight_drive.town, tmp_path / "maps" / "straight" / "town.xodr")
    shutil.copy(straight_drive.episode, tmp_path / "mine" / "straight.mcap")
    monkeypatch.setenv("CARLALOC_MAPS", str(tmp_path / "maps"))
    return config_of(tmp_path / "data", tmp_path / "mine")


def test_a_dataset_is_made_kept_and_made_again(
    config: DatasetConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = plan_dataset(config)
    assert (plan.sequences, plan.driven_s) == (6, 1.0)
    # Cut off where all drives are whole and the recipe is yet to be listed: the same call goes on.
    with monkeypatch.context() as patch:
        patch.setattr(factory, "write_manifest", lambda *_: (_ for _ in ()).throw(WriterError("cut off")))
        with pytest.raises(WriterError, match="cut off"):
            make_dataset(config)
    told: list[str] = []
    make_dataset(config, lambda done_s, total_s, what: told.append(what))
    assert told == [], "the replay was whole"
    assert len(DatasetManifest.read(config.out).sequences) == 6
    assert read_checksums(config.out) == checksums(config.out)
    names = sorted(path.name for path in config.out.iterdir())
    assert names == ["SHA256SUMS", "dataset.yaml", "episodes", "straight"]
    assert subprocess.run(["sha256sum", "-c", "--quiet", "SHA256SUMS"], cwd=config.out).returncode == 0
    assert verify(config.out).findings == ()
    with pytest.raises(WriterError, match="other weathers"):
        make_dataset(replace(config, replay=replace(config.replay, weathers=("ClearNoon",))))
    again = config_of(tmp_path / "again", config.out / "episodes")
    make_dataset(again)
    assert checksums(again.out) == read_checksums(config.out)


def test_too_little_room_is_told_after_the_first_unit_and_the_same_call_goes_on(
    config: DatasetConfig,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
) -> None:
    """What is said to be needed is what all sequences take in the end, and the spools of the other level."""
    full = shutil.disk_usage("/")._replace(free=1000)
    with monkeypatch.context() as patch:
        patch.setattr(shutil, "disk_usage", lambda _: full)
        with pytest.raises(WriterError, match=r"about 0\.0 GB \(±10%\), and 0\.0 GB are free"):
            make_dataset(config)
        assert not list(config.out.rglob("*.spool"))
        # An estimate that is too small by far leaves it to the first unit.
        patch.setattr(cost, "SIZE_ERROR", 1.0)
        with pytest.raises(WriterError, match="1 parts are whole, and the same command resumes"):
            make_dataset(config)
    weighed: Any = next(record.args for record in caplog.records if "by its first" in record.message)
    spools = sum(file.stat().st_size for file in config.out.rglob("*.spool"))
    words = ["dataset", "--out", str(config.out), "--towns", "straight", "--sample", "1", "--rig", "state"]
    words += ["--episodes", str(config.episodes), "--format", "rosbag1", "--workers", "1"]
    assert main(words) == 2
    assert "drives of 1, all sequences of 0 of 1 town, and 1 units" in capsys.readouterr().err
    calls: list[tuple[float, float, str]] = []
    make_dataset(config, lambda *call: calls.append(call))
    sequences = sum(file.stat().st_size for file in config.out.glob("straight/*_*/*"))
    assert weighed[0].written_bytes + weighed[0].spooled_bytes == pytest.approx(
        sequences + spools, rel=0.02, abs=1e6
    )
    assert spools + sequences > 2e6
    assert [done for done, *_ in calls] == sorted(done for done, *_ in calls)
    assert calls[-1][:2] == pytest.approx((1.0, 1.0))
    assert calls[-1][2] == "replaying straight (1 of 1), 100%"
    assert verify(config.out).findings == ()


def test_a_drive_that_is_missing_is_named(config: DatasetConfig) -> None:
    with pytest.raises(ConfigError, match=r"no Town01\.mcap"):
        plan_dataset(replace(config, towns=("straight", "Town01")))
    with pytest.raises(ConfigError, match="no town 'Town99'"):
        replace(config, towns=("Town99",))


def test_nobody_is_asked_where_nobody_is(
    config: DatasetConfig, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["dataset", "--out", str(config.out), "--towns", "straight", "--sample", "1", "--rig", "state"]
    assert main([*words, "--episodes", str(config.episodes)]) == 2
    told = capsys.readouterr().err
    lines = told.splitlines()
    assert lines[0] == "6 sequences: 1 town, ClearNoon, FoggyNoon, RainyNight; static, dynamic"
    assert lines[1] == f"0:00:01 of driving by drives of {config.episodes}"
    assert re.match(
        r"about [\d.]+ GB and at times [\d.]+ GB more \(±10%\); about \d+ s with \d+ process", lines[2]
    )
    assert "going on" not in told
    assert "give --yes" in told
    assert not config.out.exists()
