"""What a recording loses: killed at any moment, and on a disk that fills up."""

import logging
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from shared_fixtures.processes.small_disks import small_disk

from carlaloc_env.core.errors import EpisodeError
from recorder.drive.record import RecordConfig, record
from recorder.episode.episode import open_episode
from recorder.episode.repair import repair_episode


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    with small_disk(tmp_path / "disk", 300 << 10) as folder:
        yield folder


def test_full_disk_loses_at_most_the_last_second(disk: Path, tmp_path: Path) -> None:
    out = disk / "drive.mcap"
    with pytest.raises(EpisodeError, match="No space left") as failure:
        record(RecordConfig(map="Town03", out=out, duration_s=60.0, traffic="0.2"))
    assert str(out) in str(failure.value)
    assert not out.exists()
    kept = open_episode(out)
    used = (disk / "drive.mcap.recording").stat().st_size
    assert used > 200_000
    # A second of this drive takes less than 60 kB: what fits on the disk is there.
    assert kept.duration_s > 3.0
    whole = repair_episode(out, tmp_path / "saved.mcap")
    assert whole.complete
    assert whole.ego.tobytes() == kept.ego.tobytes()


DRIVE = """
import sys, time
from pathlib import Path
from recorder.drive.record import RecordConfig, record
out = Path(sys.argv[1])
record(
    RecordConfig(map="Town03", out=out, traffic="0.2"),
    progress=lambda driven_s, _: print(time.monotonic(), driven_s, flush=True),
)
"""
"""Records until it is killed; prints when it had driven how far [s]."""


@pytest.mark.soak
@pytest.mark.timeout(3600)
def test_killed_at_fifty_random_moments(
    tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    """SIGKILL at any moment: what was driven until a second before is there, and can be repaired."""
    rng = random.Random(50)
    worst_s, read = 0.0, 0
    for trial in range(50):
        out = tmp_path / f"{trial}.mcap"
        told = tmp_path / f"{trial}.txt"
        part = out.with_name(out.name + ".recording")
        with told.open("w") as answers:
            child = subprocess.Popen(
                [sys.executable, "-c", DRIVE, str(out)],
                cwd=Path(__file__).parents[2],
                stdout=answers,
                stderr=subprocess.DEVNULL,
            )
        end = time.monotonic() + 600.0
        while not part.exists() and time.monotonic() < end:
            time.sleep(0.005)
        time.sleep(rng.uniform(0.0, 6.0))
        os.kill(child.pid, signal.SIGKILL)
        killed = time.monotonic()
        child.wait()
        assert not out.exists()
        lines = [line.split() for line in told.read_text().splitlines() if line[:1].isdigit()]
        driven = [(float(when), float(seconds)) for when, seconds in lines]
        safe_s = max((seconds for when, seconds in driven if when < killed - 1.0), default=0.0)
        kept_s = _kept_s(out)
        assert kept_s >= safe_s
        lost = [killed - when for when, seconds in driven if seconds > kept_s + 0.01]
        worst_s = max([worst_s, *lost])
        if kept_s > 0.0:
            read += 1
            assert repair_episode(out, tmp_path / f"{trial}_whole.mcap").complete
    logging.getLogger(__name__).info("%d of 50 hold a drive; at most %.2f s were lost", read, worst_s)
    assert read > 30
    record_property("what", "SIGKILL at a random moment of a recording")
    record_property("inputs", 50)
    record_property("lost", f"at most {worst_s:.2f} s")


def _kept_s(out: Path) -> float:
    """Length of what can be read of a recording [s]; 0 of one killed before its header was written."""
    try:
        episode = open_episode(out)
    except EpisodeError:
        return 0.0
    return episode.duration_s if len(episode.ego) else 0.0
