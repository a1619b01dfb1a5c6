"""Rigs and episodes of strangers: nothing outside `--out` is written, no map is opened by their word."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from carlaloc_env.core.errors import EpisodeError
from carlaloc_env.map.sources import find_town
from recorder.cli.main import main
from recorder.episode.actor_messages import actor_frames
from recorder.episode.edit import write_episode
from recorder.episode.episode import Episode
from recorder.episode.episode_town import town_id_of
from recorder.replaying.options import ReplayConfig
from recorder.replaying.plan import plan_replay

EVIL_RIG = """\
name: evil
sensors:
- {kind: imu, name: ../../escaped}
- {kind: speed}
"""


def renamed(source: Path, out: Path, map_name: str, town_hash: str | None = None) -> Path:
    """A copy of an episode that names another map."""
    episode = Episode.load(source)
    header = replace(episode.header, map_name=map_name, town_hash=town_hash or episode.header.town_hash)
    frames = actor_frames(episode.steps)
    write_episode(out, header, episode.ego, frames, episode.steps["signals"], [], overwrite=False)
    return out


def test_a_rig_cannot_write_outside(short_drive: Path, tmp_path: Path) -> None:
    rig = tmp_path / "evil.yaml"
    rig.write_text(EVIL_RIG)
    out = tmp_path / "deep" / "out"
    assert main(["replay", str(short_drive), "--out", str(out), "--rig", str(rig)]) == 1
    assert [path.name for path in tmp_path.rglob("*")] == ["evil.yaml"]


def test_an_episode_names_no_map_by_path(short_drive: Path, tmp_path: Path) -> None:
    """The path is that of a good map with the right hash, and still it is not opened."""
    mine = tmp_path / "Mine.xodr"
    source = find_town("Town03")
    shutil.copy(source, mine)
    for k, name in enumerate((str(mine), str(source), "../Mine.xodr", str(source.parent), "Mine.xodr")):
        episode = renamed(short_drive, tmp_path / f"{k}.mcap", name)
        with pytest.raises(EpisodeError, match=r"--map FILE\.xodr"):
            plan_replay(ReplayConfig(episode=episode, out=tmp_path / "out", rig="state"))
    # With the map from the command line the same file is a good episode.
    plan = plan_replay(ReplayConfig(episode=episode, out=tmp_path / "out", rig="state", map=source))
    assert plan.town.name == "Town03"
    assert not (tmp_path / "out").exists()


def test_another_map_than_the_driven_one_is_refused(short_drive: Path, tmp_path: Path) -> None:
    episode = Episode.load(short_drive)
    with pytest.raises(EpisodeError, match="driven in Town03, not in Town05"):
        town_id_of(episode, "Town05")
