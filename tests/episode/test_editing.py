"""New episodes from recorded ones: what is kept is kept bit for bit, and the rest is refused in words."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from carlaloc_env.core.errors import ConfigError, EpisodeError
from carlaloc_env.scene.semantic_tags import Tag
from recorder.cli.main import main
from recorder.drive.record import RecordConfig, record
from recorder.drive.resimulate import change_traffic
from recorder.episode.actor_messages import actor_states
from recorder.episode.edit import cut_episode, drop_actors, join_episodes, thin_actors
from recorder.episode.ego_messages import EgoRow
from recorder.episode.episode import Episode
from recorder.episode.traffic_level import traffic_level
from recorder.episode.writer import EpisodeWriter


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("drive") / "drive.mcap"
    record(RecordConfig(map="Town03", out=out, duration_s=8.0, seed=5, traffic="0.6"))
    return out


def test_cut_keeps_every_bit(drive: Path, tmp_path: Path) -> None:
    whole = Episode.load(drive)
    part = cut_episode(drive, tmp_path / "part.mcap", 2.0, 6.5)
    assert part.duration_s == pytest.approx(4.505)
    for name in ("position_m", "quat_xyzw", "wheel_spin_radps", "raw_steer", "throttle"):
        assert part.ego[name].tobytes() == whole.ego[name][400 : 400 + len(part.ego)].tobytes(), name
    a, b = whole.timeline(), part.timeline()
    for k in range(0, 4_400_000_000, 333_000_000):
        one, other = a.actors_at(2_000_000_000 + k), b.actors_at(k)
        assert one.position_m.tobytes() == other.position_m.tobytes()
        assert a.signals_at(2_000_000_000 + k).tolist() == b.signals_at(k).tolist()
    assert part.header.history == ("cut 2 to 6.5 s of drive.mcap",)
    assert part.header.town_hash == whole.header.town_hash
    with pytest.raises(EpisodeError, match=r"lasts 8\.00 s"):
        cut_episode(drive, tmp_path / "no.mcap", 5.0, 9.0)
    assert not (tmp_path / "no.mcap").exists()


def test_join_undoes_a_cut_at_a_standstill(drive: Path, tmp_path: Path) -> None:
    """The drive begins with two seconds at rest: cut at 1 s, joined again, it is what it was."""
    first = tmp_path / "a.mcap"
    second = tmp_path / "b.mcap"
    cut_episode(drive, first, 0.0, 1.0)
    whole = cut_episode(drive, tmp_path / "w.mcap", 0.0, 7.0)
    cut_episode(drive, second, 1.0, 7.0)
    joined = join_episodes(first, second, tmp_path / "j.mcap")
    assert len(joined.ego) == len(whole.ego)
    assert np.abs(joined.ego["position_m"] - whole.ego["position_m"]).max() < 1e-5
    assert joined.ego["position_m"][400:].tobytes() == whole.ego["position_m"][400:].tobytes()
    assert joined.steps["x_fraction"].tobytes() == whole.steps["x_fraction"].tobytes()
    assert [event.kind for event in joined.events].count("joint") == 1
    speed = np.diff(joined.ego["position_m"], axis=0) * 200.0
    assert np.abs(np.diff(speed[:380], axis=0)).max() * 200.0 < 0.5, "no jolt at the joint"


def test_join_refuses_a_moving_car(drive: Path, tmp_path: Path) -> None:
    cut_episode(drive, tmp_path / "a.mcap", 0.0, 7.5)
    cut_episode(drive, tmp_path / "b.mcap", 0.0, 2.0)
    with pytest.raises(EpisodeError, match="does not stand"):
        join_episodes(tmp_path / "a.mcap", tmp_path / "b.mcap", tmp_path / "j.mcap")


def test_joint_eases_a_small_step_without_a_jolt(drive: Path, tmp_path: Path) -> None:
    cut_episode(drive, tmp_path / "a.mcap", 0.0, 1.5)
    episode = cut_episode(drive, tmp_path / "b0.mcap", 0.0, 1.8)
    frames = actor_states(episode.steps)
    with EpisodeWriter(tmp_path / "b.mcap", episode.header) as writer:
        for k, row in enumerate(episode.ego):
            if k % 10 == 0:
                frame = type(frames)(**{n: getattr(frames, n)[k // 10] for n in type(frames).__slots__})
                writer.step(k // 10, frame, episode.steps["signals"][k // 10])
            moved = EgoRow.of(row)
            writer.ego(k, replace(moved, position_m=row["position_m"] + np.array([0.03, 0.0, 0.0])))
    joined = join_episodes(tmp_path / "a.mcap", tmp_path / "b.mcap", tmp_path / "j.mcap")
    speed = np.diff(joined.ego["position_m"], axis=0) * 200.0
    acceleration = np.diff(speed, axis=0)[250:] * 200.0
    assert np.abs(acceleration).max() < 5.78 * 0.03 * 1.2, "a min-jerk step of 3 cm in 1 s"


def test_actors_can_be_dropped_and_thinned(drive: Path, tmp_path: Path) -> None:
    whole = Episode.load(drive)
    bare = drop_actors(drive, tmp_path / "bare.mcap", ["all"])
    assert len(bare.header.catalog) == 0
    assert bare.ego.tobytes() == whole.ego.tobytes()
    cars = drop_actors(drive, tmp_path / "cars.mcap", ["walkers", str(int(whole.header.catalog.id[0]))])
    assert not np.any(cars.header.catalog.tag == Tag.PEDESTRIAN)
    assert int(whole.header.catalog.id[0]) not in cars.header.catalog.id
    assert len(cars.header.catalog) > 5
    thin = thin_actors(drive, tmp_path / "thin.mcap", 0.5)
    expected = traffic_level("0.5").select(whole.timeline())
    assert thin.header.catalog.id.tolist() == expected.catalog.id.tolist()
    there, here = expected.actors_at(3_000_000_000), thin.timeline().actors_at(3_000_000_000)
    assert there.position_m.tobytes() == here.position_m.tobytes()
    with pytest.raises(ConfigError, match="did you mean 'walkers'"):
        drop_actors(drive, tmp_path / "x.mcap", ["walker"])


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
    out = tmp_path / "cut.mcap"
    words = ["edit", "cut", str(drive), "--start", "1", "--end", "3", "--out", str(out), "--json"]
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out)["duration_s"] == pytest.approx(2.005)
    assert main(words) == 1
    assert "exists" in capsys.readouterr().err
    assert main(["edit", "actors", str(drive), "--out", str(tmp_path / "x.mcap")]) == 2
    assert "--drop" in capsys.readouterr().err
