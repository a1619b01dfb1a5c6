"""Writing an episode: names, gaps, exceptions, full disks."""

from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.drives.episodes import frame_of, header_of, row_of, write_drive

from carlaloc_env.core.errors import EpisodeError, OutputError
from recorder.episode.episode import Episode, open_episode
from recorder.episode.writer import EpisodeWriter


def test_existing_names_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with EpisodeWriter(path, header_of(0)) as writer:
        write_drive(writer, 3, 0)
        for overwrite in (False, True):
            with pytest.raises(OutputError, match=r"carlaloc info --repair .*a\.mcap\.recording"):
                EpisodeWriter(path, header_of(0), overwrite=overwrite)
    with pytest.raises(OutputError, match="move it away"):
        EpisodeWriter(path, header_of(0))
    with EpisodeWriter(path, header_of(0), overwrite=True) as writer:
        write_drive(writer, 5, 0)
        assert len(Episode.load(path).ego) == 3
    assert len(Episode.load(path).ego) == 5


def test_exception_keeps_what_was_recorded(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"

    def crash() -> None:
        with EpisodeWriter(path, header_of(0)) as writer:
            write_drive(writer, 42, 0)
            raise RuntimeError

    with pytest.raises(RuntimeError):
        crash()
    assert not path.exists()
    assert len(open_episode(path).ego) == 42


def test_gaps_are_refused(tmp_path: Path) -> None:
    with EpisodeWriter(tmp_path / "a.mcap", header_of(1)) as writer:
        with pytest.raises(EpisodeError, match="tick 1 recorded where 0"):
            writer.ego(1, row_of(1))
        with pytest.raises(EpisodeError, match="step 2 recorded where 0"):
            writer.step(2, frame_of(2, 1), np.zeros(1, np.uint8))
        with pytest.raises(EpisodeError, match="2 actors"):
            writer.step(0, frame_of(0, 2), np.zeros(1, np.uint8))
