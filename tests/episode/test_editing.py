"""The traffic of a recorded drive simulated anew: the ego stays bit for bit."""

import json
from pathlib import Path

import numpy as np
import pytest

from recorder.cli.main import main
from recorder.drive.change_traffic import change_traffic
from recorder.drive.record import RecordConfig, record
from recorder.episode.actor_messages import actor_states
from recorder.episode.episode import Episode


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("drive") / "drive.mcap"
    record(RecordConfig(map="Town03", out=out, duration_s=8.0, seed=5, traffic="0.6"))
    return out


@pytest.mark.long
def test_other_traffic_leaves_the_ego_alone_and_the_same_seed_gives_the_same(
    drive: Path, tmp_path: Path
) -> None:
    whole = Episode.load(drive)
    change_traffic(drive, tmp_path / "same.mcap", 5)
    same = Episode.load(tmp_path / "same.mcap")
    before, after = actor_states(whole.steps), actor_states(same.steps)
    assert np.abs(before.position_m - after.position_m).max() < 0.01
    change_traffic(drive, tmp_path / "other.mcap", 6)
    other = Episode.load(tmp_path / "other.mcap")
    assert other.ego.tobytes() == whole.ego.tobytes()
    assert len(other.header.catalog) == len(whole.header.catalog)
    moved = actor_states(other.steps).position_m
    assert np.abs(moved - before.position_m).max() > 5.0
    assert other.header.seed == 6
    assert other.header.history[-1].startswith("traffic seed 6")


def test_edit_command(drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "other.mcap"
    words = ["edit", "traffic", str(drive), "--seed", "8", "--out", str(out), "--json"]
    assert main(words) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["duration_s"] == pytest.approx(8.005)
    assert result["touching_s"] >= 0.0
    assert main(words) == 1
    assert "exists" in capsys.readouterr().err
    assert main(words[:3]) == 2
    assert "--seed" in capsys.readouterr().err
