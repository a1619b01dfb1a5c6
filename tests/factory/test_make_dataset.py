"""The whole dataset in small: planned, refused, made, kept, verified, and made again from its manifest."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from shared_fixtures.drives.straight_drives import StraightDrive

from carlaloc_env.core.errors import ConfigError, WriterError
from carlaloc_env.rigs.presets import rig_by_name
from recorder.cli.main import main
from recorder.dataset.checksums import checksums, read_checksums
from recorder.dataset.manifest import DatasetManifest
from recorder.factory import make_dataset as dataset
from recorder.factory import plan as dataset_plan
from recorder.factory.make_dataset import copy_manifest, make_dataset
from recorder.factory.plan import DatasetConfig, plan_dataset
from recorder.factory.size_estimate import bytes_per_second
from recorder.factory.time_left import DatasetProgress
from recorder.replaying.plan import ReplayOptions
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
        patch.setattr(dataset, "write_manifest", lambda *_: (_ for _ in ()).throw(WriterError("cut off")))
        with pytest.raises(WriterError, match="cut off"):
            make_dataset(config)
    stages: list[DatasetProgress] = []
    make_dataset(config, stages.append)
    assert stages == [], "the replay was whole"
    assert len(DatasetManifest.read(config.out).sequences) == 6
    assert read_checksums(config.out) == checksums(config.out)
    names = sorted(path.name for path in config.out.iterdir())
    assert names == ["SHA256SUMS", "dataset.yaml", "episodes", "straight"]
    assert subprocess.run(["sha256sum", "-c", "--quiet", "SHA256SUMS"], cwd=config.out).returncode == 0
    assert verify(config.out).findings == ()
    with pytest.raises(WriterError, match="other weathers"):
        make_dataset(replace(config, replay=replace(config.replay, weathers=("ClearNoon",))))
    copy_manifest(config.out, tmp_path / "manifest")
    again = config_of(tmp_path / "again", tmp_path / "manifest" / "episodes")
    make_dataset(again)
    assert checksums(again.out) == read_checksums(tmp_path / "manifest")


@pytest.mark.skipif(sys.platform != "linux", reason="locks as on Linux")
def test_a_second_run_at_once_is_refused(config: DatasetConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    """While one is at work, another with the same words is refused, and what there is stays."""
    refused: list[str] = []

    def meanwhile(*_: Any) -> None:
        with pytest.raises(WriterError, match=r"another run is at work in .*; wait until") as failure:
            make_dataset(config)
        refused.append(str(failure.value))
        raise WriterError("the first run ends here")

    with monkeypatch.context() as patch:
        patch.setattr(dataset, "replay", meanwhile)
        with pytest.raises(WriterError, match="ends here"):
            make_dataset(config)
    assert len(refused) == 1
    assert "\n" not in refused[0]
    make_dataset(config)
    assert verify(config.out).findings == ()


def test_too_little_room_is_told_before_the_first_byte(
    config: DatasetConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = shutil.disk_usage("/")._replace(free=1000)
    monkeypatch.setattr(dataset_plan.shutil, "disk_usage", lambda _: free)
    told = r"needs about [\d.]+ MB while it is made, and 1 kB are free in .*; make room for [\d.]+ MB, or"
    with pytest.raises(WriterError, match=told):
        plan_dataset(config)
    assert not config.out.exists()


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
    assert lines[1] == f"1 s of driving by drives of {config.episodes}"
    assert re.match(r"about \d+ s with \d+ process", lines[2])
    assert re.match(r"about [\d.]+ MB in .*; [\d.]+ MB of \S+ [TG]B free are taken", lines[3])
    assert "give --yes" in told
    assert not config.out.exists()


def test_size_of_the_papers_rig_as_bags() -> None:
    """Two cameras of 1280×720 at 20 Hz: colour 3, depth 4, labels 1 byte a pixel; clouds besides."""
    pictures = 2 * 1280 * 720 * 20 * 8
    assert pictures < bytes_per_second(rig_by_name("paper"), ("rosbag1",), "standard") < 1.4 * pictures
