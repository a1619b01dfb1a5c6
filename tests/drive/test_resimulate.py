"""Recorded controls driven again, tick by tick."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from carlaloc_env.core.errors import ConfigError, EpisodeError
from recorder.drive.record import RecordConfig, record
from recorder.drive.resimulate import resimulate
from recorder.episode.ego_messages import EgoRow
from recorder.episode.episode import Episode
from recorder.episode.writer import EpisodeWriter


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("drive") / "short.mcap"
    record(RecordConfig(map="Town03", out=out, duration_s=6.0, seed=3, traffic="0.4"))
    return out


def test_recorded_controls_drive_the_same_again(drive: Path, tmp_path: Path) -> None:
    again = resimulate(drive, out=tmp_path / "again.mcap")
    assert again.first_difference_tick is None, again.verdict
    assert again.largest_m == 0.0
    first, second = Episode.load(drive), Episode.load(tmp_path / "again.mcap")
    assert first.ego.tobytes() == second.ego.tobytes()
    assert first.steps.tobytes() == second.steps.tobytes()


def test_a_drive_keeps_its_ride(drive: Path, tmp_path: Path) -> None:
    """Another ride moves the body otherwise, and the episode names it."""
    out = tmp_path / "real.mcap"
    record(RecordConfig(map="Town03", out=out, duration_s=2.0, seed=3, traffic="static", ride="real"))
    assert Episode.load(out).header.ride == "real"
    assert resimulate(out).first_difference_tick is None
    assert Episode.load(drive).header.ride == "standard"
    assert "ride" not in Episode.load(drive).header.extra


def test_unknown_rides_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="standard"):
        RecordConfig(out=tmp_path / "a.mcap", ride="soft")


def test_a_single_changed_pedal_is_found(drive: Path, tmp_path: Path) -> None:
    """One throttle value, 0.01 larger, is reported within two ticks."""
    episode = Episode.load(drive)
    path = tmp_path / "changed.mcap"
    at = next(k for k in range(600, len(episode.ego)) if episode.ego["throttle"][k] > 0.1)
    frames = episode.timeline()
    with EpisodeWriter(path, episode.header) as writer:
        for k, row in enumerate(episode.ego):
            controls = episode.controls.at(k)
            if k == at:
                controls = replace(controls, throttle=controls.throttle + 0.01)
            if k % 10 == 0 and k // 10 < len(episode.steps):
                writer.step(k // 10, frames.actors_at(k * 5_000_000), frames.signals_at(k * 5_000_000))
            vectors = ("position_m", "quat_xyzw", "velocity_world_mps", "omega_body_radps")
            numbers = ("road_wheel_rad", "speed_mps")
            motion = {name: row[name] for name in vectors} | {name: float(row[name]) for name in numbers}
            writer.ego(k, EgoRow(controls=controls, **motion))
    result = resimulate(path)
    assert result.first_difference_tick is not None
    assert at <= result.first_difference_tick <= at + 2
    assert str(result.first_difference_tick) in result.verdict


def test_edited_episodes_are_not_driven_again(drive: Path, tmp_path: Path) -> None:
    episode = Episode.load(drive)
    with EpisodeWriter(tmp_path / "cut.mcap", replace(episode.header, history=("cut 0 to 2 s",))) as writer:
        writer.ego(0, EgoRow(position_m=np.zeros(3), quat_xyzw=(0.0, 0.0, 0.0, 1.0)))
    with pytest.raises(EpisodeError, match="edited"):
        resimulate(tmp_path / "cut.mcap")
