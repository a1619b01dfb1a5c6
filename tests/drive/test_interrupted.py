"""A recording that is asked to end says where the drive is; what it says works."""

import json
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from recorder.cli.main import main
from recorder.episode.actor_messages import actor_frames
from recorder.episode.edit import write_episode
from recorder.episode.episode import Episode
from recorder.episode.writer import EpisodeWriter

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals as on POSIX")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_drive_is_where_the_message_says(
    number: signal.Signals, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "drive.mcap"
    words = ["record", "--map", "Town03", "--traffic", "static", "--out", str(out), "--json"]
    child = subprocess.Popen(
        [sys.executable, "-m", "recorder.cli.main", *words],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    part = tmp_path / "drive.mcap.recording"
    end = time.monotonic() + 600.0
    while not part.exists() or part.stat().st_size < 30_000:
        assert child.poll() is None, child.communicate()
        assert time.monotonic() < end
        time.sleep(0.05)
    child.send_signal(number)
    stdout, stderr = child.communicate(timeout=600)
    assert child.returncode == 1
    told = json.loads(stdout)["error"]
    assert told in stderr
    assert str(part) in told
    assert "--force" not in told

    for force in ([], ["--force"]):
        assert main([*words[:-1], *force]) == 1
        refused = capfd.readouterr().err
        assert "carlaloc info --repair" in refused
        assert "--force" not in refused
    repair = shlex.split(told.split("make it whole with: carlaloc ")[1])
    assert main(repair) == 0
    assert Episode.load(out).duration_s > 0.5


def test_an_edit_that_fails_leaves_nothing(
    short_drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And what a killed one leaves does not stand in the way of the next."""

    def interrupted(self: EpisodeWriter, tick: int, row: object) -> None:
        raise KeyboardInterrupt

    def copy() -> Episode:
        whole = Episode.load(short_drive)
        frames, signals = actor_frames(whole.steps), whole.steps["signals"]
        return write_episode(out, whole.header, whole.ego, frames, signals, [], overwrite=False)

    out = tmp_path / "part.mcap"
    monkeypatch.setattr(EpisodeWriter, "ego", interrupted)
    with pytest.raises(KeyboardInterrupt):
        copy()
    monkeypatch.undo()
    assert list(tmp_path.iterdir()) == []
    (tmp_path / ".part.mcap.part").write_bytes(b"of a killed one")
    assert copy().complete
    assert [path.name for path in tmp_path.iterdir()] == ["part.mcap"]
