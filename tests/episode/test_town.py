"""The town of an episode is known without building it, and must be the one that was driven in."""

from __future__ import annotations

from pathlib import Path

import pytest
from shared_fixtures.drives.episodes import write_drive

from carlaloc_env.core.errors import EpisodeError, MapError
from carlaloc_env.town.sources import find_town, identify_town
from recorder.drive.resimulate import resimulate
from recorder.episode.episode import Episode, EpisodeHeader, EpisodeWriter
from recorder.episode.header import WORLD_VERSION, _checksum
from recorder.episode.town import town_id_of, town_of


@pytest.fixture
def town(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of Town01 that may be changed, known by its name."""
    monkeypatch.setenv("CARLALOC_MAPS", str(tmp_path / "maps"))
    source, folder = find_town("Town01"), tmp_path / "maps" / "Mine"
    folder.mkdir(parents=True)
    for name in ("town.xodr", "town.toml"):
        (folder / name).write_bytes(source.with_name(name).read_bytes())
    return folder


def drive_in(town: Path, path: Path, world_version: int = WORLD_VERSION) -> Episode:
    key = identify_town(town).content_hash
    header = EpisodeHeader(map_name=town.name, map_hash=key, world_version=world_version)
    with EpisodeWriter(path, header) as writer:
        write_drive(writer, 11, 0)
    return Episode.load(path)


def test_its_name_and_hash_are_read_and_nothing_is_built(
    town: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Building leaves a file in the cache."""
    monkeypatch.setenv("CARLALOC_CACHE", str(tmp_path / "cache"))
    episode = drive_in(town, tmp_path / "a.mcap")
    found = town_id_of(episode)
    assert (found.name, found.content_hash) == ("Mine", episode.header.map_hash)
    assert len(found.content_hash) == 32
    assert not (tmp_path / "cache").exists()


@pytest.mark.parametrize("changed", ["town.xodr", "town.toml"])
def test_a_changed_map_is_refused(town: Path, tmp_path: Path, changed: str) -> None:
    episode = drive_in(town, tmp_path / "a.mcap")
    with (town / changed).open("a") as file:
        file.write("\n")
    for ask in (town_id_of, town_of):
        with pytest.raises(EpisodeError, match=r"another version of Mine .* record it again"):
            ask(episode)


def test_a_town_that_is_gone_is_a_named_error(town: Path, tmp_path: Path) -> None:
    episode = drive_in(town, tmp_path / "a.mcap")
    (town / "town.xodr").unlink()
    with pytest.raises(EpisodeError, match=r"no town .Mine.*--map"):
        town_id_of(episode)
    with pytest.raises(MapError, match="no file"):
        town_id_of(episode, town / "town.xodr")


@pytest.mark.parametrize("version", [1, WORLD_VERSION + 1])
def test_a_drive_in_another_world_is_refused(town: Path, tmp_path: Path, version: int) -> None:
    """Also by whoever drives its controls again; the version survives the file."""
    episode = drive_in(town, tmp_path / "a.mcap", version)
    assert episode.header.world_version == version
    for ask in (town_id_of, town_of):
        with pytest.raises(EpisodeError, match=rf"world version {version}.* record it again"):
            ask(episode)
    with pytest.raises(EpisodeError, match="record it again"):
        resimulate(tmp_path / "a.mcap")


def test_drives_before_versions_were_of_the_first_world() -> None:
    """Headers of old files name none."""
    texts = EpisodeHeader(map_name="Town03").to_metadata()
    texts.pop("world_version")
    texts["crc32"] = str(_checksum(texts))
    assert EpisodeHeader.from_metadata(texts).world_version == 1
