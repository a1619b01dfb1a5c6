"""Data sets of recorded drives hold what an environment shows, takes and pays for the same drive."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils import seeding

import carlaloc_env  # noqa: F401  registers the environments
from carlaloc_env.core.clock import STEP_TICKS
from carlaloc_env.core.ego import Controls
from carlaloc_env.core.errors import ConfigError, EpisodeError, OutputError
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.envs.carlaloc_env import CarlaLocEnv
from carlaloc_env.town.build import load_town
from carlaloc_env.traffic.traffic_config import traffic_of_town
from recorder.cli.main import main
from recorder.drive.episode_listener import EpisodeListener
from recorder.drive.record_agent import RecordDrive
from recorder.episode.episode_header import EpisodeHeader
from recorder.episode.writer import EpisodeWriter
from recorder.minari.dataset import MinariConfig, write_minari

VILLAGE = Path(__file__).parents[1] / "data" / "village.xodr"
TRAFFIC = "dynamic,vehicles=3,walkers=0"
SEED = 3
STEPS = 40


def _actions(count: int) -> list[tuple[float, float]]:
    """Steering and pedal of some steps: off, to and fro, and braking in the end."""
    wave = [(0.05 * np.sin(0.3 * k), 0.6 if k < count - 10 else -0.4) for k in range(count)]
    return [(float(np.float32(steer)), float(np.float32(pedal))) for steer, pedal in wave]


def _record(map_path: Path, out: Path, controls: Sequence[Controls]) -> Path:
    """An episode of a drive on the seed that an environment of seed `SEED` draws, and its last ticks."""
    drive_seed = int(seeding.np_random(SEED)[0].integers(2**31))
    town = load_town(map_path)
    traffic = traffic_of_town(town, TRAFFIC, drive_seed)
    world = DrivingWorld(town, traffic)
    header = EpisodeHeader(
        map_name=town.name, town_hash=town.town_hash, seed=drive_seed, traffic=asdict(traffic), device="test"
    )
    listener = EpisodeListener(lambda catalog: EpisodeWriter(out, replace(header, catalog=catalog)))
    world.reset(drive_seed, listener)
    for one in controls:
        for _ in range(STEP_TICKS):
            world.tick(one)
    listener.writer.close()
    world.close()
    return out


@pytest.fixture(scope="module")
def drive(straight_map: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    controls = [Controls(steer=s, throttle=max(p, 0.0), brake=max(-p, 0.0)) for s, p in _actions(STEPS)]
    return _record(straight_map, tmp_path_factory.mktemp("drive") / "drive.mcap", controls)


def _load(path: Path) -> Any:
    minari = pytest.importorskip("minari", reason="data sets need the extra `minari`")
    return minari.MinariDataset(path / "data")


def _parts(seen: Any) -> list[Any]:
    return [seen[key] for key in sorted(seen)] if isinstance(seen, dict) else [seen]


@pytest.mark.parametrize(("rig", "skip"), [("state", 1), ("bev", 4), ("minimal", 2)])
def test_it_holds_what_an_environment_shows_for_the_same_actions(
    drive: Path, straight_map: Path, tmp_path: Path, rig: str, skip: int
) -> None:
    """Observations to the rounding of an attitude, rewards, and ends, step by step."""
    pytest.importorskip("minari", reason="data sets need the extra `minari`")
    if rig == "minimal":
        from shared_fixtures.worlds.render_scenes import need_opengl

        need_opengl()
    config = MinariConfig(
        episodes=(drive,), out=tmp_path / "straight-test-v0", rig=rig, map=straight_map,
        frame_skip=skip, quality="low",
    )  # fmt: skip
    result = write_minari(config)
    (told,) = list(_load(config.out).iterate_episodes())
    env = CarlaLocEnv(map=straight_map, rig=rig, traffic=TRAFFIC, quality="low", info=())
    seen, _ = env.reset(seed=SEED)
    rewards = []
    for number in range(result.steps * skip):
        if number % skip == 0:
            for one, other in zip(_parts(told.observations), _parts(seen), strict=True):
                assert one.dtype == other.dtype
                np.testing.assert_allclose(one[number // skip], other, atol=1e-6)
        seen, reward, ended, over, _ = env.step(np.array(_actions(STEPS)[number], np.float32))
        assert not ended
        assert not over
        rewards.append(reward)
    for one, other in zip(_parts(told.observations), _parts(seen), strict=True):
        np.testing.assert_allclose(one[-1], other, atol=1e-6)
    assert result.steps * skip == pytest.approx(STEPS - 2, abs=4)
    np.testing.assert_allclose(told.rewards, np.add.reduceat(rewards, np.arange(0, len(rewards), skip)))
    expected = np.array(_actions(STEPS)[: result.steps * skip]).reshape(-1, skip, 2).mean(axis=1)
    np.testing.assert_allclose(told.actions, expected, atol=1e-7)
    assert told.truncations.tolist() == [False] * (result.steps - 1) + [True]
    assert not told.terminations.any()
    env.close()


def test_its_environment_and_its_counts_are_known(drive: Path, straight_map: Path, tmp_path: Path) -> None:
    """Two drives of another kind of action, longer than a stretch in memory, through the command line."""
    pytest.importorskip("minari", reason="data sets need the extra `minari`")
    words = ["minari", str(drive), str(drive), "--out", str(tmp_path / "two-v1")]
    assert main([*words, "--map", str(straight_map), "--action", "controls"]) == 0
    found = _load(tmp_path / "two-v1")
    assert (found.total_episodes, found.id) == (2, "two-v1")
    assert found.total_steps == sum(len(one) for one in found.iterate_episodes())
    lengths = [int(one["total_steps"]) for one in found.storage.get_episode_metadata([0, 1])]
    assert lengths == [len(one) for one in found.iterate_episodes()]
    env = found.recover_environment()
    assert env.action_space == found.action_space == gymnasium.spaces.Box(
        np.array([-1, 0, 0, 0, 0], np.float32), np.ones(5, np.float32)
    )  # fmt: skip
    assert env.observation_space == found.observation_space
    env.close()
    assert gymnasium.spec("CarlaLoc-v0").kwargs == {}


def test_a_data_set_of_several_towns_recovers_each_from_any_folder(
    tmp_path: Path, straight_map: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Maps found by name, a rig's file, and all paths relative to a folder that is left afterwards."""
    pytest.importorskip("minari", reason="data sets need the extra `minari`")
    monkeypatch.setenv("CARLALOC_MAPS", str(tmp_path / "maps"))
    for name, length in (("Long", "300"), ("Short", "200")):
        town = tmp_path / "maps" / name / "town.xodr"
        town.parent.mkdir(parents=True)
        town.write_text(straight_map.read_text().replace('length="300"', f'length="{length}"'))
        _record(town, tmp_path / f"{name}.mcap", [Controls(throttle=0.5)] * 20)
    monkeypatch.chdir(tmp_path)
    Path("few.yaml").write_text("name: few\nsensors:\n- {kind: imu}\n- {kind: gnss}\n")
    drives = ["Long.mcap", "Short.mcap", "Long.mcap"]
    assert main(["minari", *drives, "--rig", "few.yaml", "--out", "sets/two-towns-v0"]) == 0
    (tmp_path / "away").mkdir()
    monkeypatch.chdir(tmp_path / "away")
    found = _load(tmp_path / "sets" / "two-towns-v0")
    env = found.recover_environment()
    assert env.observation_space == found.observation_space
    known = found.storage.get_episode_metadata(range(3))
    begun = [env.reset(seed=1, options=one["options"])[1] for one in known]
    assert [info["town"] for info in begun] == ["Long", "Short", "Long"]
    assert begun[0]["route_length_m"] == pytest.approx(begun[1]["route_length_m"] + 100.0)
    assert {info["weather"] for info in begun} == {"ClearNoon"}
    env.close()


def test_stretches_in_memory_join_without_a_seam(
    drive: Path, straight_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("minari", reason="data sets need the extra `minari`")
    found = []
    for number, chunk in enumerate((256, 7)):
        monkeypatch.setattr("recorder.minari.dataset._CHUNK", chunk)
        out = tmp_path / f"drive-v{number}"
        write_minari(MinariConfig(episodes=(drive,), out=out, map=straight_map))
        found.append(next(iter(_load(out).iterate_episodes())))
    for name in ("observations", "actions", "rewards", "terminations", "truncations"):
        np.testing.assert_array_equal(*(getattr(one, name) for one in found))


@pytest.mark.parametrize(
    ("changes", "error", "why"),
    [
        ({"action": "controll"}, ConfigError, "controls"),
        ({"out": Path("no version")}, ConfigError, "end it in a version"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    drive: Path, straight_map: Path, tmp_path: Path, changes: dict[str, Any], error: type, why: str
) -> None:
    pytest.importorskip("minari", reason="data sets need the extra `minari`")
    settings: dict[str, Any] = {"out": tmp_path / "one-v0", "map": straight_map, **changes}
    with pytest.raises(error, match=why) as caught:
        write_minari(MinariConfig(episodes=(drive,), **settings))
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_rewards_of_a_random_route_are_the_environments(tmp_path: Path) -> None:
    """Of the route, start and task in the drive's header, not of the town's route; ends are the agent's."""
    pytest.importorskip("minari", reason="data sets need the extra `minari`")
    env = RecordDrive(
        CarlaLocEnv(VILLAGE, "state", traffic="empty", route="random", start=0.3, task={"off_route_m": 3.0}),
        tmp_path / "agent.mcap",
    )
    seen, info = env.reset(seed=6)
    shown, rewards, ended = [seen], [], False
    while not ended:
        seen, reward, ended, _, info = env.step(np.array([0.4, 0.5], np.float32))
        shown.append(seen)
        rewards.append(reward)
    env.close()
    assert info["ended_by"] in ("off_route", "off_road")
    out = tmp_path / "village-agent-v0"
    write_minari(MinariConfig(episodes=(Path(info["drive_file"]),), out=out, map=VILLAGE))
    (told,) = list(_load(out).iterate_episodes())
    np.testing.assert_allclose(told.rewards, rewards, atol=1e-9)
    np.testing.assert_allclose(told.observations, shown, atol=1e-6)
    assert told.terminations.tolist() == [False] * (len(rewards) - 1) + [True]
    (known,) = _load(out).storage.get_episode_metadata([0])
    again = _load(out).recover_environment()
    _, begun = again.reset(options=known["options"])
    assert begun["route_length_m"] == pytest.approx(info["route_length_m"], abs=1e-9)
    again.close()


def test_a_data_set_is_not_replaced_and_reversing_needs_five_numbers(
    straight_map: Path, tmp_path: Path
) -> None:
    pytest.importorskip("minari", reason="data sets need the extra `minari`")
    back = _record(straight_map, tmp_path / "back.mcap", [Controls(throttle=0.4, reverse=True)] * 20)
    config = MinariConfig(episodes=(back,), out=tmp_path / "sets" / "back-v0", map=straight_map)
    with pytest.raises(EpisodeError, match="--action controls"):
        write_minari(config)
    five = replace(config, action="controls")
    write_minari(five)
    (told,) = list(_load(config.out).iterate_episodes())
    np.testing.assert_allclose(told.actions[5], [0.0, 0.4, 0.0, 1.0, 0.0], atol=1e-7)
    with pytest.raises(OutputError, match="exists"):
        write_minari(five)


def test_a_replay_says_where_such_data_sets_are_made(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", str(drive), "--out", str(tmp_path / "out"), "--format", "minari"]) == 1
    assert "use `carlaloc minari`" in capsys.readouterr().err
