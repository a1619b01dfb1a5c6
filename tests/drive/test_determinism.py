"""Recorded controls, simulated again, give the same drive."""

from pathlib import Path

import pytest
from shared_fixtures.drives.driven_again import assert_same_again

from carlaloc_env.core.errors import ConfigError
from recorder.drive.record import RecordConfig, record
from recorder.episode.episode import Episode


def test_recorded_controls_drive_the_same_again(tmp_path: Path) -> None:
    out = tmp_path / "short.mcap"
    record(RecordConfig(map="Town03", out=out, duration_s=6.0, seed=3, traffic="0.4"))
    assert Episode.load(out).header.ride == "standard"
    assert "ride" not in Episode.load(out).header.extra
    assert_same_again(out)


def test_a_drive_keeps_its_ride(tmp_path: Path) -> None:
    """Another ride moves the body otherwise, and the episode names it."""
    out = tmp_path / "real.mcap"
    record(RecordConfig(map="Town03", out=out, duration_s=2.0, seed=3, traffic="static", ride="real"))
    assert Episode.load(out).header.ride == "real"
    assert_same_again(out)


def test_unknown_rides_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="standard"):
        RecordConfig(out=tmp_path / "a.mcap", ride="soft")
