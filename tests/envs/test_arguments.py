"""Arguments and actions as programs give them: kept as JSON, NumPy's numbers, a rounding beyond a bound."""

import json
from inspect import signature
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from shared_fixtures.drives.straight_drives import MakeEnv

from carlaloc_env.core.ego import Controls
from carlaloc_env.core.errors import ActionError
from carlaloc_env.envs.any_town_env import AnyTownEnv
from carlaloc_env.envs.carlaloc_env import CarlaLocEnv
from carlaloc_env.envs.task.actions import PEDALS, STEERS, action_kind
from carlaloc_env.envs.task.task_config import TaskConfig
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.weather.parameters import WeatherParameters
from carlaloc_env.weather.presets import weather_by_name
from carlaloc_env.weather.schedule import WeatherSchedule

FOG = WeatherParameters(fog_density=60.0)
ALL_OTHERS: tuple[dict[str, Any], ...] = (
    {
        "rig": rig_by_name("state"),
        "action": "discrete",
        "weather": WeatherSchedule(at_s=(0.0, 9.5), weathers=(FOG, weather_by_name("RainyNight"))),
        "traffic": {"level": np.float64(0.5), "vehicles": np.int64(2), "parked_cars": False},
        "route": np.array([[20.0, 0.0], [120.0, 0.0]]),
        "start": np.float64(0.25),
        "frame_skip": np.int64(2),
        "task": TaskConfig(goal=3.0),
        "info": ("ego", "truth"),
        "quality": "low",
        "render_mode": "rgb_array",
    },
    {"rig": "bev", "weather": FOG, "traffic": np.float64(0.5), "task": {"goal": np.float32(3.5)}},
)


@pytest.mark.parametrize("others", ALL_OTHERS)
def test_a_specification_goes_to_json_and_back(straight_map: Path, others: dict[str, Any]) -> None:
    """Every argument, in what Minari and loggers keep: the same drive comes out of it."""
    env = gymnasium.make("CarlaLoc-v0", map=straight_map, **others)
    assert env.spec is not None
    text = env.spec.to_json()
    again = gymnasium.make(EnvSpec.from_json(text))
    assert again.spec is not None
    assert json.loads(again.spec.to_json()) == json.loads(text)
    one, other = env.unwrapped, again.unwrapped
    assert isinstance(one, CarlaLocEnv)
    assert isinstance(other, CarlaLocEnv)
    assert (one.task, one.weather, one.rig) == (other.task, other.weather, other.rig)
    told = []
    for made in (one, other):
        length_m = made.reset(seed=1)[1]["route_length_m"]
        told.append((length_m, made.step(12 if "action" in others else [0.0, 0.5])[1]))
        made.close()
    assert told[0] == told[1]


def test_json_was_tried_with_every_argument() -> None:
    """A new one must find its place above."""
    assert {"map", *ALL_OTHERS[0]} == set(signature(CarlaLocEnv).parameters)


def test_a_specification_of_any_town_goes_to_json_and_back(straight_map: Path) -> None:
    settings: dict[str, Any] = {"towns": (straight_map,), "weathers": (FOG,), "traffic": (np.float64(0.0),)}
    settings |= {"routes": (np.array([[20.0, 0.0], [120.0, 0.0]]),), "kept_towns": np.int64(1)}
    env = gymnasium.make("CarlaLoc-AnyTown-v0", rig="state", frame_skip=4, **settings)
    assert set(settings) == set(signature(AnyTownEnv).parameters) - {"settings"}
    assert env.spec is not None
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.metadata["render_fps"] == env.metadata["render_fps"] == 5.0
    np.testing.assert_array_equal(env.reset(seed=4)[0], again.reset(seed=4)[0])
    for one in (env, again):
        one.close()


def test_numbers_of_numpy_are_numbers(make_env: MakeEnv) -> None:
    """As tuners and `np.arange` give them: the same drive as with Python's."""
    found = []
    for whole, real in ((int, float), (np.int64, np.float32), (np.uint8, np.float64)):
        task = {"goal": real(5), "time_limit_s": whole(60)}
        env = make_env(action="discrete", traffic=real(0.5), frame_skip=whole(4), task=task)
        seen, _ = env.reset(seed=whole(3))
        moved = env.step(whole(24))
        found.append([*seen.tolist(), *moved[0].tolist(), moved[1], env.task.goal])
    assert found[0] == found[1] == found[2]


def test_actions_mean_controls() -> None:
    """Of every kind, in every kind of number: full brake to the left."""
    five = action_kind("controls").controls([1.0, 0.0, 1.0, 0.6, 0.4])
    assert five == Controls(steer=1.0, brake=1.0, reverse=True)
    two = action_kind("continuous").controls(np.array([0.5, -0.25], np.float32))
    assert two == Controls(steer=0.5, brake=0.25)
    table = action_kind("discrete")
    seen = {(c.steer, c.throttle - c.brake) for c in map(table.controls, range(len(STEERS) * len(PEDALS)))}
    assert seen == {(steer, pedal) for steer in STEERS for pedal in PEDALS}
    assert table.controls(7) == table.controls(np.int64(7)) == table.controls(np.array([7]))
    for bad in (-1, len(STEERS) * len(PEDALS), 1.5, "x", True, [7, 7]):
        with pytest.raises(ActionError, match="whole number from 0 to 44"):
            table.controls(bad)


@pytest.mark.parametrize("beyond", [np.nextafter(np.float32(1), np.float32(2)), 1.0 + 0.9e-6])
def test_what_rounding_puts_beyond_a_bound_lies_on_it(beyond: float) -> None:
    """A network's last layer in single precision ends a few ulps beyond 1."""
    two, five = action_kind("continuous").controls, action_kind("controls").controls
    assert two([beyond, -beyond]) == Controls(steer=1.0, brake=1.0)
    assert five([-beyond, beyond, 1.0 - beyond, beyond, 0.0]) == Controls(
        steer=-1.0, throttle=1.0, reverse=True
    )


@pytest.mark.parametrize("beyond", [1.0 + 1.1e-6, 1.5, np.nan, np.inf])
def test_what_lies_farther_out_is_refused(beyond: float) -> None:
    two, five = action_kind("continuous").controls, action_kind("controls").controls
    with pytest.raises(ActionError, match=r"^pedal is .*; give a finite number from -1 to 1$"):
        two([0.0, -beyond])
    with pytest.raises(ActionError, match=r"^throttle is .*; give a finite number from 0 to 1$"):
        five([0.0, 1.0 - beyond, 0.0, 0.0, 0.0])
