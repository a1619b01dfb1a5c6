"""The environment: Gymnasium's contract, the same bytes, rewards, and refusals in one line."""

import json
import pickle
import re
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from shared_fixtures.drives.straight_drives import MakeEnv
from shared_fixtures.worlds.render_scenes import need_opengl

import carlaloc_env
from carlaloc_env.core.errors import ActionError, CarlaLocError, ConfigError
from carlaloc_env.envs.any_town_env import AnyTownEnv
from carlaloc_env.envs.carlaloc_env import CarlaLocEnv
from carlaloc_env.envs.task.birds_eye_view import BirdsEyeView
from carlaloc_env.envs.task.referee import TERMS
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.sensors.imu import ImuConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.weather.presets import weather_by_name
from carlaloc_env.weather.schedule import weather_of

GO = np.array([0.0, 0.4], np.float32)
FEW = "dynamic,vehicles=3,walkers=0"
IMU = SensorRig(name="imu", sensors=(ImuConfig(),))
LIDAR = SensorRig(name="lidar", sensors=(LidarConfig(columns=200), ImuConfig()))


@pytest.fixture
def env(make_env: MakeEnv) -> CarlaLocEnv:
    return make_env(traffic=FEW)


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(_same(a[key], b[key]) for key in a)
    return bool(np.array_equal(a, b)) and np.asarray(a).tobytes() == np.asarray(b).tobytes()


@pytest.mark.parametrize("action", ["controls", "continuous", "ackermann", "discrete"])
def test_gymnasium_checks_pass_with_every_kind_of_action(action: str, make_env: MakeEnv) -> None:
    env = make_env(action=action, traffic=FEW)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env, skip_render_check=True)


def test_every_town_is_registered() -> None:
    """One family: each town has an id, and all of them have the same class."""
    names = {f"CarlaLoc-{town}-v0": {"map": town} for town in (*carlaloc_env.TOWNS, "Town10HD")}
    specs = {name: gymnasium.spec(name) for name in gymnasium.registry if name.startswith("CarlaLoc-")}
    assert specs.pop("CarlaLoc-AnyTown-v0").entry_point == "carlaloc_env.envs.any_town_env:AnyTownEnv"
    assert specs.pop("CarlaLoc-Replay-v0").entry_point == "recorder.episode_env.replay_env:ReplayEnv"
    assert {name: spec.kwargs for name, spec in specs.items()} == {**names, "CarlaLoc-v0": {}}
    assert {spec.entry_point for spec in specs.values()} == {"carlaloc_env.envs.carlaloc_env:CarlaLocEnv"}


def _drive(env: gymnasium.Env[Any, Any], seed: int, steps: int = 30) -> list[Any]:
    observation, _ = env.reset(seed=seed)
    told = [observation]
    for number in range(steps):
        action = np.array([0.05 * np.sin(number), 0.5], np.float32)
        observation, reward, ended, over, info = env.step(action)
        told += [observation, reward, ended, over, list(info["reward_terms"].values())]
    return told


@pytest.mark.parametrize("rig", ["bev", LIDAR], ids=["bev", "lidar"])
def test_the_same_seed_is_the_same_drive(make_env: MakeEnv, rig: str | SensorRig) -> None:
    """In another environment, after other episodes, and in a copy."""
    settings: dict[str, Any] = {"rig": rig, "traffic": FEW, "route": "random"}
    first, second = make_env(**settings), make_env(**settings)
    told, other = _drive(first, 4), _drive(second, 4)
    assert all(_same(a, b) for a, b in zip(told, other, strict=True))
    first.reset(seed=5, options={"route": "town", "traffic": "empty", "weather": "RainyNight"})
    first.step(GO)
    assert all(_same(a, b) for a, b in zip(told, _drive(first, 4), strict=True))
    copied = pickle.loads(pickle.dumps(first))
    assert all(_same(a, b) for a, b in zip(told, _drive(copied, 4), strict=True))
    assert not all(_same(a, b) for a, b in zip(told, _drive(second, 5), strict=True))
    copied.close()


def test_vectors_of_environments_agree_byte_for_byte(make_env: MakeEnv, straight_map: Path) -> None:
    """Synchronous, in processes of their own, and alone, over the ends of episodes."""
    settings: dict[str, Any] = {"map": str(straight_map), "rig": "state", "traffic": FEW}
    settings["task"] = {"time_limit_s": 0.4}
    found = []
    for mode in ("sync", "async"):
        both = gymnasium.make_vec("CarlaLoc-v0", num_envs=2, vectorization_mode=mode, **settings)
        observation, _ = both.reset(seed=7)
        told = [observation]
        for _ in range(20):
            observation, reward, *_ = both.step(np.array([[0.0, 0.5], [0.1, 0.3]], np.float32))
            told += [observation, reward]
        found.append(told)
        both.close()
    assert all(_same(a, b) for a, b in zip(*found, strict=True))
    alone, over, reward = make_env(**settings), False, 0.0
    assert _same(alone.reset(seed=8)[0], found[0][0][1])
    for number in range(20):
        if over:
            observation, reward, over = alone.reset()[0], 0.0, False
        else:
            observation, reward, _, over, _ = alone.step(np.array([0.1, 0.3], np.float32))
        assert _same(observation, found[0][1 + 2 * number][1])
        assert reward == found[0][2 + 2 * number][1]


@pytest.mark.parametrize("rig", ["state", "bev"])
def test_a_frame_skip_is_as_many_steps(make_env: MakeEnv, rig: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is drawn for steps after which nobody looks, and nothing that is seen depends on that."""
    single, four = (make_env(rig=rig, traffic=FEW, frame_skip=skip) for skip in (1, 4))
    single.reset(seed=1)
    four.reset(seed=1)
    earned = [single.step(GO) for _ in range(8)]
    drawn, draw = [], BirdsEyeView.draw
    monkeypatch.setattr(BirdsEyeView, "draw", lambda view, world: drawn.append(1) or draw(view, world))
    for number in range(2):
        observation, reward, _, _, info = four.step(GO)
        steps = earned[4 * number : 4 * number + 4]
        assert _same(observation, steps[-1][0])
        assert reward == pytest.approx(sum(step[1] for step in steps), abs=1e-12)
        assert info["stamp_ns"] == (number + 1) * 200_000_000
    assert len(drawn) == (2 if rig == "bev" else 0)


def test_no_sample_of_a_skipped_step_is_lost(make_env: MakeEnv) -> None:
    env = make_env(rig=IMU, frame_skip=4)
    env.reset(seed=1)
    stamps = [sample.stamp_ns for sample in env.step(GO)[-1]["samples"]]
    assert stamps == [5_000_000 * (k + 1) for k in range(40)]


def test_rewards_are_the_sum_of_their_terms(make_env: MakeEnv) -> None:
    """That of progress is the metres driven, as the truth tells them."""
    env = make_env(traffic=FEW, info=("truth",))
    start = env.reset(seed=2)[1]["truth"].position_m
    progress_m = 0.0
    for _ in range(40):
        _, reward, _, _, info = env.step(GO)
        assert tuple(info["reward_terms"]) == TERMS
        assert reward == pytest.approx(sum(info["reward_terms"].values()))
        progress_m += info["reward_terms"]["progress"]
    assert progress_m == pytest.approx(float(np.linalg.norm(info["truth"].position_m - start)), rel=0.02)
    assert 0.0 < info["route_completion"] < 1.0
    assert info["is_success"] is False


def test_observation_and_truth_agree(make_env: MakeEnv) -> None:
    """The speedometer and the last truth show the same speed; at rest the IMU reads gravity upwards."""
    env = make_env(rig=rig_by_name("state"), traffic=FEW, info=("samples", "truth"))
    observation, info = env.reset(seed=1)
    assert observation["imu"].shape == (10, 6)
    for _ in range(40):
        observation, _, _, _, info = env.step(GO)
    speed = float(np.linalg.norm(info["truth"].velocity_world_mps))
    assert float(observation["speed"][0]) == pytest.approx(speed, abs=0.15)
    env.reset(seed=1)
    rest = np.array([0.0, -1.0], np.float32)
    readings = np.concatenate([env.step(rest)[0]["imu"] for _ in range(20)])
    assert readings[:, 2].mean() == pytest.approx(9.81, abs=0.02)


@pytest.mark.parametrize(
    ("kind", "bad"),
    [
        ("continuous", [np.nan, 0.0]),
        ("continuous", [0.0, np.inf]),
        ("continuous", [2.0, 0.0]),
        ("continuous", [0.0]),
        ("continuous", "left"),
        ("controls", [0, -0.1, 0, 0, 0]),
        ("controls", [0, 0, 0, 0, 7]),
        ("controls", [0, 0, 0]),
        ("ackermann", [0.0, 1.5]),
        ("discrete", 45),
    ],
)
def test_bad_actions_move_nothing(make_env: MakeEnv, kind: str, bad: Any) -> None:
    env = make_env(action=kind)
    env.reset(seed=3)
    before = env.world.now_ns, env.world.state.position_m.copy()
    with pytest.raises(ActionError, match=r"give .*(number|finite)"):
        env.step(bad)
    assert env.world.now_ns == before[0]
    np.testing.assert_array_equal(env.world.state.position_m, before[1])


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"map": "Town3"}, "did you mean 'Town03'"),
        ({"rig": "papper"}, "did you mean 'paper'"),
        ({"rig": {"name": "mine", "sensers": []}}, "did you mean 'sensors'"),
        ({"weather": "ClearNon"}, "did you mean 'ClearNoon'"),
        ({"weather": {"fog_densty": 3.0}}, "did you mean 'fog_density'"),
        ({"weather": {"fog_density": "thick"}}, "give numbers"),
        ({"traffic": "dynamc"}, "did you mean 'dynamic'"),
        ({"action": "continous"}, "did you mean 'continuous'"),
        ({"task": {"colision": 3.0}}, "did you mean 'collision'"),
        ({"task": {"collision": -1.0}}, "collision is -1.0; give a finite number of 0 or more"),
        ({"frame_skip": 0}, "give 1 to 200 steps"),
        ({"info": ("objekts",)}, "did you mean 'objects'"),
        ({"render_mode": "humans"}, "did you mean 'human'"),
        ({"route": "rondom"}, "did you mean 'random'"),
    ],
)
def test_wrong_arguments_name_the_nearest(settings: dict[str, Any], words: str, straight_map: Path) -> None:
    with pytest.raises(CarlaLocError, match=re.escape(words)) as error:
        CarlaLocEnv(**{"map": straight_map, "rig": "state", **settings})
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"rout": "town"}, "did you mean 'route'"),
        ({"spawn": (0.0, 900.0)}, "off every lane"),
        ({"goal": "home"}, "give a point (x, y)"),
        ({"route": [(float("nan"), 0.0), (1.0, 0.0)]}, "finite"),
        ({"route": "random", "goal": (1.0, 0.0)}, "leave one of the two out"),
        ({"start": 1.0}, "give 'anywhere', or a share of the route from 0 to below 1"),
        ({"start": "anywere"}, "give 'anywhere'"),
    ],
)
def test_wrong_options_are_refused_in_one_line(env: CarlaLocEnv, options: dict[str, Any], words: str) -> None:
    with pytest.raises(CarlaLocError, match=re.escape(words)) as error:
        env.reset(seed=1, options=options)
    assert "\n" not in str(error.value)
    env.reset(seed=1)


def test_options_hold_for_one_episode(env: CarlaLocEnv) -> None:
    """Another route, weather and traffic; after that the environment's own again."""
    own, _ = env.reset(seed=1)
    _, info = env.reset(seed=1, options={"spawn": (50.0, 0.0), "goal": (150.0, 0.0), "traffic": "empty"})
    assert info["route_length_m"] == pytest.approx(100.0, abs=1.0)
    assert env.world.state.position_m[0] == pytest.approx(50.0, abs=0.5)
    assert len(env.world.timeline.catalog) == 0
    _, _ = env.reset(seed=1, options={"weather": "RainyNight"})
    assert env.weather.at(0).is_night
    again, _ = env.reset(seed=1)
    assert not env.weather.at(0).is_night
    assert _same(own, again)


def test_a_start_on_the_way_leaves_the_route_before_it_out(make_env: MakeEnv) -> None:
    """The end stays; `anywhere` is drawn by the seed, evenly over nine tenths of the way."""
    env = make_env(start="anywhere")
    _, whole = env.reset(seed=1, options={"start": 0.0})
    begin, end = env.world.route.position_m[[0, -1]]
    _, half = env.reset(seed=1, options={"start": 0.5})
    assert half["route_length_m"] == pytest.approx(0.5 * whole["route_length_m"], abs=env.world.route.step_m)
    np.testing.assert_allclose(env.world.route.position_m[-1], end)
    np.testing.assert_allclose(env.world.state.position_m[:2], 0.5 * (begin + end)[:2], atol=0.5)
    seeds = [*range(12), 0]
    shares = [1.0 - env.reset(seed=seed)[1]["route_length_m"] / whole["route_length_m"] for seed in seeds]
    assert shares[0] == shares[-1]
    assert -1e-9 <= min(shares) <= max(shares) < 0.9
    # The mean of 12 draws from 0 to 0.9 has a standard error of 0.075.
    assert np.mean(shares[:-1]) == pytest.approx(0.45, abs=0.25)


def test_rendering_gives_a_picture(make_env: MakeEnv) -> None:
    """`render` gives an RGB picture that is neither black nor white nor flat."""
    need_opengl()
    env = make_env(traffic=FEW, render_mode="rgb_array")
    with pytest.raises(ActionError, match="render before reset"):
        env.render()
    env.reset(seed=0)
    picture = env.render()
    assert picture is not None
    assert picture.shape == (360, 640, 3)
    assert 30 < picture.mean() < 225
    assert picture.std() > 15


def test_any_town_draws_by_the_seed(straight_map: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.xodr"
    other.write_text(Path(straight_map).read_text().replace('length="300"', 'length="200"'))
    settings: dict[str, Any] = {"traffic": ["empty", "static"], "routes": ["town"], "rig": "state"}
    env = AnyTownEnv(towns=[str(straight_map), str(other)], kept_towns=1, **settings)
    told = []
    for seed in range(8):
        told.append(env.reset(seed=seed)[1])
        now = env.now
        assert weather_of(told[-1]["weather"]) == now.weather
        assert told[-1]["traffic"] == ("static" if now.world.traffic_config.parked_cars else "empty")
        assert told[-1]["route"] == "town"
    assert {info["town"] for info in told} == {str(straight_map), str(other)}
    again = env.reset(seed=3)[1]
    assert (again["town"], again["route_length_m"]) == (told[3]["town"], told[3]["route_length_m"])
    fog = replace(weather_by_name("ClearNoon"), fog_density=40.0)
    begun = env.reset(seed=3, options={"town": str(other), "weather": fog, "route": "random"})[1]
    for info in (begun, env.step(GO)[4]):
        assert (info["town"], info["route"]) == (str(other), "random")
        assert weather_of(json.loads(info["weather"])) == fog
    env.close()
    for call in (env.reset, env.render, lambda: env.step(GO)):
        with pytest.raises(CarlaLocError, match="after close"):
            call()
    for seed in (-1, 0.5):
        with pytest.raises(ConfigError, match="the seed is"):
            AnyTownEnv(towns=[str(other)], **settings).reset(seed=seed)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="no weather to draw"):
        AnyTownEnv(towns=[str(straight_map)], weathers=[])
