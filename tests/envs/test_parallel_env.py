"""Several agents in one town: PettingZoo's own tests, collisions, leaving, one car as in the single env."""

import gymnasium
import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

from carlaloc_env import parallel_env
from carlaloc_env.core.errors import ActionError, ConfigError
from carlaloc_env.envs.parallel_env import CarsEnv

CALM = {"map": "Town01", "rig": "state", "traffic": "static"}
GO, STAND = np.array([0.0, 0.5], np.float32), np.array([0.0, -1.0], np.float32)


def test_pettingzoos_own_tests_pass() -> None:
    """Its API test over several episodes, and its seed test."""
    env = parallel_env(**CALM, cars=3, task={"time_limit_s": 4.0})
    parallel_api_test(env, num_cycles=200)
    env.close()
    parallel_seed_test(lambda: parallel_env(**CALM, cars=2), num_cycles=40)


def test_one_car_drives_as_in_the_single_environment() -> None:
    """The same drive, observations and rewards, bit for bit, for the same seed of the drive."""
    single = gymnasium.make("CarlaLoc-Town01-v0", rig="state", traffic=0.3)
    several = parallel_env(map="Town01", rig="state", traffic=0.3, cars=1)
    first, info = single.reset(seed=8)
    observations, infos = several.reset(seed=8)
    assert infos["car_1"]["drive_seed"] == info["drive_seed"]
    np.testing.assert_array_equal(observations["car_1"], first)
    for _ in range(40):
        seen, reward, *_ = single.step(GO)
        observations, rewards, *_ = several.step({"car_1": GO})
        np.testing.assert_array_equal(observations["car_1"], seen)
        assert rewards["car_1"] == reward
    single.close()
    several.close()


def drive_into_each_other(env: CarsEnv) -> dict[str, dict[str, object]]:
    """The car behind drives straight on, the one ahead of it stands."""
    env.reset(seed=1)
    for _ in range(400):
        actions = {agent: GO if agent == "car_1" else STAND for agent in env.agents}
        *_, infos = env.step(actions)
        if "car_1" not in env.agents:
            break
    return infos


def test_cars_see_and_touch_each_other_and_leave() -> None:
    """The car behind runs into the one ahead; both are told of it, and the town has them no longer."""
    env = parallel_env(**CALM, cars=2, overlap=1.0)
    env.reset(seed=1)
    first, second = env.world.cars
    # Full overlap: the second begins 15 m further on the same route, in sight of the first.
    ahead = first.timeline.actors_at(0).position_m[-1]
    np.testing.assert_allclose(ahead[:2], second.as_seen().position_m[:2], atol=0.01)
    assert 14.0 < np.linalg.norm(ahead[:2] - np.array(first.as_seen().position_m[:2])) < 16.0
    infos = drive_into_each_other(env)
    touched = {contact.actor_id for contact in infos["car_1"]["contacts"]}  # type: ignore[attr-defined]
    assert infos["car_1"]["ended_by"] == "collision"
    assert touched == {second.body.actor_id}
    assert infos["car_2"]["ended_by"] == "collision"
    assert env.agents == []
    env.close()


def test_a_car_that_left_is_neither_seen_nor_touched() -> None:
    """A car drives through the place of one that has left."""
    env = parallel_env(**CALM, cars=2, overlap=1.0)
    env.reset(seed=1)
    env.world.leave(1)
    env.agents.remove("car_2")
    place = env.world.cars[1].state.position_m[:2].copy()
    nearest = np.inf
    for _ in range(120):
        env.step({"car_1": GO})
        if not env.agents:
            break
        nearest = min(nearest, float(np.linalg.norm(env.world.cars[0].state.position_m[:2] - place)))
        assert env.world.cars[0].actors().position_m[-1, 2] < -900.0
    assert nearest < 1.0
    env.close()


def test_bad_input_is_refused_by_name() -> None:
    """Numbers of cars, overlaps and missing actions."""
    with pytest.raises(ConfigError, match="0 cars"):
        parallel_env(**CALM, cars=0)
    with pytest.raises(ConfigError, match="too short for 16 cars"):
        parallel_env(map="Town06", rig="state", traffic="static", cars=16, overlap=1.0, start=0.8).reset(
            seed=0
        )
    env = parallel_env(**CALM, cars=2)
    env.reset(seed=0)
    with pytest.raises(ActionError, match="car_2 has no action"):
        env.step({"car_1": GO})
    env.close()
