"""What a recording loses: killed at any moment, and on a disk that fills up."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from carlaloc_env.errors import EpisodeError
from recorder.episode import Episode, open_episode
from recorder.episode_repair import repair_episode
from recorder.record import RecordConfig, record


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 300 kB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=300k", "tmpfs", str(folder)]
    if sys.platform != "linux" or os.geteuid() != 0 or subprocess.run(command, check=False).returncode:
        pytest.skip("mounting a small disk needs root on Linux")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_full_disk_loses_at_most_the_last_second(small_disk: Path, tmp_path: Path) -> None:
    out = small_disk / "drive.mcap"
    with pytest.raises(EpisodeError, match="No space left") as failure:
        record(RecordConfig(map="Town03", out=out, duration_s=60.0, traffic="0.2"))
    assert str(out) in str(failure.value)
    assert not out.exists()
    kept = open_episode(out)
    used = (small_disk / "drive.mcap.recording").stat().st_size
    assert used > 200_000
    # A second of this drive takes less than 60 kB: what fits on the disk is there.
    assert kept.duration_s > 3.0
    whole = repair_episode(out, tmp_path / "saved.mcap")
    assert whole.complete
    assert whole.ego.tobytes() == kept.ego.tobytes()


@pytest.mark.soak
@pytest.mark.timeout(3600)
def test_killed_at_fifty_random_moments(tmp_path: Path) -> None:
    """SIGKILL to the real command: what was driven until a second before is there, and can be repaired."""
    rng = random.Random(50)
    command = [sys.executable, "-m", "recorder.cli.main", "record", "--map", "Town03", "--traffic", "0.2"]
    read = 0
    for trial in range(50):
        out = tmp_path / f"{trial}.mcap"
        part = out.with_name(out.name + ".recording")
        child = subprocess.Popen(
            [*command, "--out", str(out)], cwd=Path(__file__).parents[2], stderr=subprocess.DEVNULL
        )
        end = time.monotonic() + 120.0
        while not part.exists() and time.monotonic() < end:
            time.sleep(0.005)
        time.sleep(rng.uniform(0.0, 3.0))
        before = part.stat().st_size
        os.kill(child.pid, signal.SIGKILL)
        child.wait()
        assert not out.exists()
        try:
            episode = open_episode(out)
        except EpisodeError:
            # Killed within its first second, before anything but the header could be on the disk.
            assert before < 100_000
            continue
        read += 1
        assert part.stat().st_size >= before
        if len(episode.ego):
            repair_episode(out, tmp_path / "whole.mcap")
            assert Episode.load(tmp_path / "whole.mcap").ego.tobytes() == episode.ego.tobytes()
            (tmp_path / "whole.mcap").unlink()
        part.unlink()
    assert read >= 45
