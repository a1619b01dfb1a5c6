"""The town of an episode is known without building it, and must be the one that was driven in."""

from pathlib import Path

import pytest
from shared_fixtures.drives.episodes import write_drive

from carlaloc_env.core.errors import EpisodeError, MapError
from carlaloc_env.town.build import load_town
from recorder.episode.episode import Episode
from recorder.episode.episode_header import EpisodeHeader, _checksum
from recorder.episode.episode_town import check_kept_town, town_id_of, town_of
from recorder.episode.writer import EpisodeWriter

SOURCE = """<?xml version="1.0"?>
<OpenDRIVE><header/>
<road name="Main" length="90.0" id="1" junction="-1"><link/>
<planView><geometry s="0" x="0" y="0" hdg="0" length="90"><line/></geometry></planView>
<lanes><laneSection s="0">
<center><lane id="0" type="none" level="false"/></center>
<right><lane id="-1" type="driving" level="false">
<width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right>
</laneSection></lanes>
</road></OpenDRIVE>
"""


@pytest.fixture
def town(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small town that may be changed, known by its name, with a cache of its own."""
    monkeypatch.setenv("CARLALOC_MAPS", str(tmp_path / "maps"))
    monkeypatch.setenv("CARLALOC_CACHE", str(tmp_path / "cache"))
    folder = tmp_path / "maps" / "Mine"
    folder.mkdir(parents=True)
    (folder / "town.xodr").write_text(SOURCE)
    (folder / "town.toml").write_text('[town]\nname = "Mine"\nscenery_seed = 5\n')
    return folder


def drive_in(town: Path, path: Path) -> Episode:
    header = EpisodeHeader(map_name=town.name, town_hash=load_town(town).town_hash, device="scripted", seed=7)
    with EpisodeWriter(path, header) as writer:
        write_drive(writer, 11, 0)
    return Episode.load(path)


def files_of(cache: Path) -> list[Path]:
    return [path for path in cache.rglob("*") if path.is_file() and path.suffix != ".lock"]


def test_its_name_is_read_and_nothing_is_built(
    town: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Building leaves files in the cache."""
    episode = drive_in(town, tmp_path / "a.mcap")
    monkeypatch.setenv("CARLALOC_CACHE", str(tmp_path / "other"))
    found = town_id_of(episode)
    assert (found.name, found.source) == ("Mine", town / "town.xodr")
    check_kept_town(episode, found)
    assert not files_of(tmp_path / "other")
    assert town_of(episode).town_hash == episode.header.town_hash


def test_a_town_whose_roads_changed_is_refused(town: Path, tmp_path: Path) -> None:
    """By whoever builds it, and before anything is built once it stands in the cache."""
    episode = drive_in(town, tmp_path / "a.mcap")
    (town / "town.xodr").write_text(SOURCE.replace('a="3.5"', 'a="3.4"'))
    check_kept_town(episode, town_id_of(episode))
    line = (
        r"another version of Mine .* record it anew: "
        "carlaloc record --map Mine --device scripted --seed 7 --out NEW.mcap$"
    )
    with pytest.raises(EpisodeError, match=line):
        town_of(episode)
    with pytest.raises(EpisodeError, match=line):
        check_kept_town(episode, town_id_of(episode))


def test_a_town_that_only_looks_different_is_the_same(town: Path, tmp_path: Path) -> None:
    """The files are others; what decides how a drive goes is not."""
    episode = drive_in(town, tmp_path / "a.mcap")
    with (town / "town.xodr").open("a") as file:
        file.write("<!-- edited -->\n")
    assert town_of(episode).town_hash == episode.header.town_hash


def test_a_town_that_is_gone_is_a_named_error(town: Path, tmp_path: Path) -> None:
    episode = drive_in(town, tmp_path / "a.mcap")
    (town / "town.xodr").unlink()
    with pytest.raises(EpisodeError, match=r"no town .Mine.*--map"):
        town_id_of(episode)
    with pytest.raises(MapError, match="no file"):
        town_id_of(episode, town / "town.xodr")


def test_drives_before_towns_had_hashes_are_refused(town: Path, tmp_path: Path) -> None:
    """Headers of old files name a hash of the map's file."""
    episode = drive_in(town, tmp_path / "a.mcap")
    texts = episode.header.to_metadata()
    texts["map_hash"] = texts.pop("town_hash").replace("0", "1").replace("a", "b")
    texts["crc32"] = str(_checksum(texts))
    with EpisodeWriter(tmp_path / "old.mcap", EpisodeHeader.from_metadata(texts)) as writer:
        write_drive(writer, 11, 0)
    with pytest.raises(EpisodeError, match="record it anew"):
        town_of(Episode.load(tmp_path / "old.mcap"))
