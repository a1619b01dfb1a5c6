"""Recordings that were killed, cut off or damaged are read up to where they are good, and never misread."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from shared_fixtures.drives.episodes import header_of, write_drive

from carlaloc_env.core.errors import EpisodeError
from recorder.episode.episode import Episode, EpisodeWriter, open_episode, repair_episode
from recorder.episode.writer import recording_path

_CHILD = """
import sys, time, numpy as np
from recorder.episode.episode import EpisodeWriter, EpisodeHeader, EgoRow
from carlaloc_env.timeline.timeline import empty_frame
with EpisodeWriter(sys.argv[1], EpisodeHeader(map_name="Town03")) as w:
    for tick in range(10**7):
        if tick % 10 == 0:
            w.step(tick // 10, empty_frame(), np.zeros(3, np.uint8))
        w.ego(tick, EgoRow(position_m=(tick, 0.5, 0.0), quat_xyzw=(0, 0, 0, 1)))
        if tick % 10 == 0:
            print(tick, flush=True)
        time.sleep(float(sys.argv[2]))
"""


@pytest.mark.long
def test_killed_recordings_are_readable_up_to_the_last_second(tmp_path: Path) -> None:
    """SIGKILL at random moments, at full speed and at real time (there the wall clock flushes)."""
    rng = random.Random(1)
    for trial in range(6):
        path = tmp_path / f"{trial}.mcap"
        child = subprocess.Popen(
            [sys.executable, "-c", _CHILD, str(path), "0.0" if trial % 2 else "0.004"],
            stdout=subprocess.PIPE,
            cwd=Path(__file__).parents[2],
        )
        assert child.stdout is not None
        child.stdout.readline()
        time.sleep(rng.uniform(0.0, 1.6))
        with pytest.raises(EpisodeError, match="is still being recorded"):
            repair_episode(path)
        os.kill(child.pid, signal.SIGKILL)
        rest, _ = child.communicate()
        printed = [int(line) for line in rest.splitlines() if line]
        reached = printed[-2] if len(printed) > 1 else 0
        assert not path.exists()
        episode = open_episode(path)
        assert not episode.complete
        assert len(episode.ego) >= reached - 200
        assert np.array_equal(episode.ego["position_m"][:, 0], np.arange(len(episode.ego)))
        with pytest.raises(EpisodeError, match=r"last good time \d+\.\d{3} s"):
            Episode.load(path)
        whole = repair_episode(path)
        assert whole.path == path
        assert whole.complete
        assert whole.ego.tobytes() == episode.ego.tobytes()
        assert not recording_path(path).exists()


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
