"""The environments that agents learn in: Gymnasium's contract, the same bytes, and refusals in one line."""

from __future__ import annotations

import pickle
import re
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import carlaloc_env
from carlaloc_env.any_town_env import AnyTownEnv
from carlaloc_env.core.errors import ActionError, CarlaLocError, ConfigError
from carlaloc_env.driving_env import DrivingEnv
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.sensors.inertial.imu import ImuConfig
from carlaloc_env.task.actions import PEDALS, STEERS, action_kind
from carlaloc_env.task.birds_eye_view import BirdsEyeView
from carlaloc_env.task.referee import TERMS

GO = np.array([0.0, 0.4], np.float32)


@pytest.fixture
def env(straight_map: Path) -> Any:
    made = DrivingEnv(map=straight_map, traffic="dynamic,vehicles=3,walkers=0")
    yield made
    made.close()


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(_same(a[key], b[key]) for key in a)
    return bool(np.array_equal(a, b)) and np.asarray(a).tobytes() == np.asarray(b).tobytes()


@pytest.mark.parametrize("rig", ["state", "bev", SensorRig(name="imu", sensors=(ImuConfig(),))])
@pytest.mark.parametrize("action", ["controls", "continuous", "discrete"])
def test_gymnasium_checks_pass_with_warnings_fatal(
    rig: str | SensorRig, action: str, straight_map: Path
) -> None:
    env = DrivingEnv(map=straight_map, rig=rig, action=action, traffic="dynamic,vehicles=3,walkers=0")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env, skip_render_check=True)
    env.close()


def test_every_town_is_registered() -> None:
    for town in carlaloc_env.TOWNS:
        assert gymnasium.spec(f"CarlaLoc-{town}-v1").kwargs == {"map": town}
    assert gymnasium.spec("CarlaLoc-v1").entry_point == "carlaloc_env.driving_env:DrivingEnv"
    assert gymnasium.spec("CarlaLoc-AnyTown-v0").entry_point == "carlaloc_env.any_town_env:AnyTownEnv"


def _drive(env: gymnasium.Env[Any, Any], seed: int, steps: int = 30) -> list[Any]:
    observation, _ = env.reset(seed=seed)
    told = [observation]
    for number in range(steps):
        action = np.array([0.05 * np.sin(number), 0.5], np.float32)
        observation, reward, ended, over, info = env.step(action)
        told += [observation, reward, ended, over, list(info["reward_terms"].values())]
    return told


def test_the_same_seed_is_the_same_drive(straight_map: Path) -> None:
    settings: dict[str, Any] = {"map": straight_map, "rig": "bev", "traffic": "dynamic,vehicles=3,walkers=0"}
    settings["route"] = "random"
    first, second = DrivingEnv(**settings), DrivingEnv(**settings)
    told, other = _drive(first, 4), _drive(second, 4)
    assert all(_same(a, b) for a, b in zip(told, other, strict=True))
    assert all(_same(a, b) for a, b in zip(told, _drive(first, 4), strict=True))
    copied = pickle.loads(pickle.dumps(first))
    assert all(_same(a, b) for a, b in zip(told, _drive(copied, 4), strict=True))
    assert not all(_same(a, b) for a, b in zip(told, _drive(second, 5), strict=True))
    for env in (first, second, copied):
        env.close()


def test_vectors_of_environments_agree_byte_for_byte(straight_map: Path) -> None:
    """Synchronous, in processes of their own, and alone."""
    settings: dict[str, Any] = {"map": str(straight_map), "traffic": "dynamic,vehicles=3,walkers=0"}
    found = []
    for mode in ("sync", "async"):
        both = gymnasium.make_vec("CarlaLoc-v1", num_envs=2, vectorization_mode=mode, **settings)
        observation, _ = both.reset(seed=7)
        told = [observation]
        for _ in range(20):
            observation, reward, *_ = both.step(np.array([[0.0, 0.5], [0.1, 0.3]], np.float32))
            told += [observation, reward]
        found.append(told)
        both.close()
    assert all(_same(a, b) for a, b in zip(*found, strict=True))
    alone = DrivingEnv(**settings)
    assert _same(alone.reset(seed=8)[0], found[0][0][1])
    for number in range(20):
        observation, reward, *_ = alone.step(np.array([0.1, 0.3], np.float32))
        assert _same(observation, found[0][1 + 2 * number][1])
        assert reward == found[0][2 + 2 * number][1]
    alone.close()


@pytest.mark.parametrize("rig", ["state", "bev"])
def test_a_frame_skip_is_as_many_steps(straight_map: Path, rig: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is drawn for steps after which nobody looks, and nothing that is seen depends on that."""
    settings: dict[str, Any] = {"map": straight_map, "rig": rig, "traffic": "dynamic,vehicles=3,walkers=0"}
    single, four = DrivingEnv(**settings), DrivingEnv(frame_skip=4, **settings)
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
    single.close()
    four.close()


def test_no_sample_of_a_skipped_step_is_lost(straight_map: Path) -> None:
    rig = SensorRig(name="imu", sensors=(ImuConfig(),))
    env = DrivingEnv(map=straight_map, rig=rig, traffic="empty", frame_skip=4, info=("samples",))
    env.reset(seed=1)
    stamps = [sample.stamp_ns for sample in env.step(GO)[-1]["samples"]]
    assert stamps == [5_000_000 * (k + 1) for k in range(40)]
    env.close()


def test_rewards_are_the_sum_of_their_terms(env: DrivingEnv) -> None:
    env.reset(seed=2)
    for _ in range(40):
        _, reward, _, _, info = env.step(GO)
        assert tuple(info["reward_terms"]) == TERMS
        assert reward == pytest.approx(sum(info["reward_terms"].values()))
    assert 0.0 < info["route_completion"] < 1.0
    assert info["is_success"] is False


@pytest.mark.parametrize("bad", [np.array([np.nan, 0.0]), np.array([0.0, np.inf]), [2.0, 0.0], [0.0], "left"])
def test_bad_actions_move_nothing(env: DrivingEnv, bad: Any) -> None:
    env.reset(seed=3)
    env.step(GO)
    before = env.world.now_ns, env.world.state.position_m.copy()
    with pytest.raises(ActionError, match=r"give .*(number|finite)"):
        env.step(bad)
    assert env.world.now_ns == before[0]
    np.testing.assert_array_equal(env.world.state.position_m, before[1])


def test_actions_mean_controls() -> None:
    """Of every kind: full brake to the left."""
    five = action_kind("controls").controls([1.0, 0.0, 1.0, 0.0, 1.0])
    assert (five.steer, five.throttle, five.brake, five.reverse, five.handbrake) == (
        1.0,
        0.0,
        1.0,
        False,
        True,
    )
    two = action_kind("continuous").controls(np.array([0.5, -0.25], np.float32))
    assert (two.steer, two.throttle, two.brake) == (0.5, 0.0, 0.25)
    table = action_kind("discrete")
    seen = {(c.steer, c.throttle - c.brake) for c in map(table.controls, range(len(STEERS) * len(PEDALS)))}
    assert seen == {(steer, pedal) for steer in STEERS for pedal in PEDALS}
    for bad in (-1, len(STEERS) * len(PEDALS), 1.5, "x"):
        with pytest.raises(ActionError, match="whole number from 0 to 44"):
            table.controls(bad)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"rig": "stat"}, "did you mean 'state'"),
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
    with pytest.raises(ConfigError, match=re.escape(words)):
        DrivingEnv(map=straight_map, **settings)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"rout": "town"}, "did you mean 'route'"),
        ({"weather": "ClearNon"}, "did you mean 'ClearNoon'"),
        ({"spawn": (0.0, 900.0)}, "off every lane"),
        ({"goal": "home"}, "give a point (x, y)"),
        ({"route": [(float("nan"), 0.0), (1.0, 0.0)]}, "finite"),
        ({"route": "random", "goal": (1.0, 0.0)}, "leave one of the two out"),
    ],
)
def test_wrong_options_are_refused_in_one_line(env: DrivingEnv, options: dict[str, Any], words: str) -> None:
    with pytest.raises(CarlaLocError, match=re.escape(words)) as error:
        env.reset(seed=1, options=options)
    assert "\n" not in str(error.value)
    env.reset(seed=1)


def test_options_hold_for_one_episode(env: DrivingEnv) -> None:
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


def test_any_town_draws_by_the_seed(straight_map: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.xodr"
    other.write_text(Path(straight_map).read_text().replace('length="300"', 'length="200"'))
    env = AnyTownEnv(
        towns=[str(straight_map), str(other)], traffic=["empty", "static"], routes=["town"], kept_towns=1
    )
    told = [env.reset(seed=seed)[1] for seed in range(8)]
    assert {info["town"] for info in told} == {str(straight_map), str(other)}
    again = env.reset(seed=3)[1]
    assert (again["town"], again["route_length_m"]) == (told[3]["town"], told[3]["route_length_m"])
    assert env.reset(seed=3, options={"town": str(other)})[1]["town"] == str(other)
    env.step(GO)
    env.close()
    for seed in (-1, 0.5):
        with pytest.raises(ConfigError, match="the seed is"):
            AnyTownEnv(towns=[str(other)], traffic=["empty"]).reset(seed=seed)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="no weather to draw"):
        AnyTownEnv(towns=[str(straight_map)], weathers=[])
