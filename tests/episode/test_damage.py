"""Recordings that were killed, cut off or damaged are read up to where they are good, and never misread."""

import random
from pathlib import Path

from shared_fixtures.drives.episodes import header_of, write_drive

from carlaloc_env.core.errors import EpisodeError
from recorder.episode.episode import Episode, open_episode
from recorder.episode.repair import repair_episode
from recorder.episode.writer import EpisodeWriter, recording_path


def test_a_recording_stays_where_it_is_not_the_whole_or_no_recording(tmp_path: Path) -> None:
    """One that is damaged in its middle may be worth more than what can be read of it today."""
    path = tmp_path / "a.mcap"
    part = recording_path(path)
    writer = EpisodeWriter(path, header_of(2))
    write_drive(writer, 900, 2)
    writer.abandon()
    data = bytearray(part.read_bytes())
    data[len(data) // 2] ^= 1
    part.write_bytes(data)
    episode = open_episode(part)
    assert "damaged" in (episode.problem or "")
    assert repair_episode(part).ego.tobytes() == episode.ego.tobytes()
    assert part.read_bytes() == data
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(data)
    assert repair_episode(copy).path == tmp_path / "copy_repaired.mcap"
    assert copy.read_bytes() == data


def test_file_cut_or_damaged_anywhere_is_never_misread(tmp_path: Path) -> None:
    """Every prefix and every flipped byte gives the true beginning of the drive or a named error."""
    path = tmp_path / "a.mcap"
    with EpisodeWriter(path, header_of(2)) as writer:
        write_drive(writer, 500, 2)
    data = path.read_bytes()
    truth = Episode.load(path).ego
    rng = random.Random(2)
    survivors = 0
    for _ in range(150):
        broken = bytearray(data[: rng.randrange(len(data))] if rng.random() < 0.5 else data)
        if len(broken) == len(data):
            broken[rng.randrange(len(data) // 2)] ^= 1 << rng.randrange(8)
        (tmp_path / "b.mcap").write_bytes(broken)
        try:
            episode = open_episode(tmp_path / "b.mcap")
        except EpisodeError:
            continue
        survivors += 1
        assert episode.ego.tobytes() == truth[: len(episode.ego)].tobytes()
        assert episode.header.to_metadata() == header_of(2).to_metadata()
    assert survivors > 30
