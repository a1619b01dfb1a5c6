"""The Gymnasium environment: its contract, determinism, and refusal of bad input."""

from __future__ import annotations

import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import carlaloc_env
from carlaloc_env.core.errors import ActionError, CarlaLocError, ConfigError, MapError, RenderError
from carlaloc_env.core.geometry.camera_model import Pinhole
from carlaloc_env.env import CarlaLocEnv, controls_of
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.sensors.camera.config import CameraConfig

COAST = np.array([0.0, 0.3, 0.0, 0.0, 0.0], np.float32)


def small_rig() -> SensorRig:
    """State, a small camera and the LiDAR."""
    lidar = rig_by_name("lidar")
    camera = next(config for config in rig_by_name("paper").sensors if isinstance(config, CameraConfig))
    small = CameraConfig(name="left", mount=camera.mount, pinhole=Pinhole.from_fov(160, 90, 90.0))
    return SensorRig(name="small", sensors=(small, *lidar.sensors))


@pytest.mark.parametrize("rig", ["state", "small"])
def test_gymnasium_checks_pass_with_warnings_fatal(rig: str) -> None:
    """Gymnasium's own checker finds nothing to complain about."""
    try:
        env = gymnasium.make("CarlaLoc-Town03-v0", rig=small_rig() if rig == "small" else rig)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            check_env(env.unwrapped, skip_render_check=True)
    except RenderError as error:
        pytest.skip(str(error))
    env.close()


def test_every_town_is_registered() -> None:
    """Each packaged town has an id, and CarlaLoc-v0 takes any map."""
    for town in carlaloc_env.TOWNS:
        assert gymnasium.spec(f"CarlaLoc-{town}-v0").kwargs == {"map": town}
    assert gymnasium.spec("CarlaLoc-v0").max_episode_steps == 12_000


def roll(env: CarlaLocEnv, seed: int, steps: int) -> list[dict[str, Any]]:
    """Observations of a drive with actions that depend on the step only."""
    observation, _ = env.reset(seed=seed)
    found = [observation]
    for step in range(steps):
        action = np.array([0.2 * np.sin(step), 0.6, 0.0, 0.0, 0.0], np.float32)
        found.append(env.step(action)[0])
    return found


def test_same_seed_same_observations() -> None:
    """Two environments with one seed agree in every byte; another seed differs."""
    first, second = CarlaLocEnv(rig="lidar"), CarlaLocEnv(rig="lidar")
    a, b = roll(first, 11, 12), roll(second, 11, 12)
    again, other = roll(first, 11, 12), roll(first, 12, 12)
    for x, y, z in zip(a, b, again, strict=True):
        for key in x:
            assert x[key].tobytes() == y[key].tobytes() == z[key].tobytes(), key
    assert a[-1]["imu"].tobytes() != other[-1]["imu"].tobytes()
    first.close()
    second.close()


@pytest.fixture(scope="module")
def env() -> CarlaLocEnv:
    """An environment without cameras and LiDAR."""
    return CarlaLocEnv(rig="state")


def test_driving_forward_earns_the_metres_driven(env: CarlaLocEnv) -> None:
    """The reward is the progress along the route, as the truth tells it."""
    _, info = env.reset(seed=1)
    start = info["truth"].position_m
    total = 0.0
    for _ in range(60):
        _, reward, terminated, truncated, info = env.step(COAST)
        total += reward
        assert not terminated
        assert not truncated
    driven = float(np.linalg.norm(info["truth"].position_m - start))
    assert driven > 3.0
    assert total == pytest.approx(driven, rel=0.05)


def test_observation_and_truth_agree(env: CarlaLocEnv) -> None:
    """The speedometer and the last truth show the same speed; at rest the IMU reads gravity upwards."""
    observation, info = env.reset(seed=1)
    assert observation["imu"].shape == (10, 6)
    for _ in range(40):
        observation, _, _, _, info = env.step(COAST)
    speed = float(np.linalg.norm(info["truth"].velocity_world_mps))
    assert float(observation["speed"][0]) == pytest.approx(speed, abs=0.15)
    env.reset(seed=1)
    rest = np.array([0.0, 0.0, 1.0, 0.0, 1.0], np.float32)
    readings = np.concatenate([env.step(rest)[0]["imu"] for _ in range(20)])
    assert readings[:, 2].mean() == pytest.approx(9.81, abs=0.02)


@pytest.mark.parametrize(
    "action",
    [
        [np.nan, 0, 0, 0, 0],
        [0, np.inf, 0, 0, 0],
        [1.5, 0, 0, 0, 0],
        [0, -0.1, 0, 0, 0],
        [0, 0, 0, 0, 7],
        [0, 0, 0],
        "left",
    ],
)
def test_bad_actions_are_refused_before_anything_moves(env: CarlaLocEnv, action: Any) -> None:
    """NaN, infinite, out-of-range or misshapen actions raise, and the world stands where it stood."""
    env.reset(seed=1)
    before = env.world.state.position_m.copy(), env.world.tick_count
    with pytest.raises(ActionError):
        env.step(action)
    assert env.world.tick_count == before[1]
    assert (env.world.state.position_m == before[0]).all()


def test_actions_become_controls() -> None:
    """Each number of the action lands in its control."""
    controls = controls_of([-0.5, 0.25, 0.75, 0.6, 0.4])
    assert (controls.steer, controls.throttle, controls.brake) == (-0.5, 0.25, 0.75)
    assert (controls.reverse, controls.handbrake) == (True, False)


@pytest.mark.parametrize(
    ("arguments", "error", "nearest"),
    [
        ({"map": "Town3"}, MapError, "Town03"),
        ({"rig": "papper"}, ConfigError, "paper"),
        ({"weather": "ClearNon"}, ConfigError, "ClearNoon"),
        ({"traffic": "dynamc"}, ConfigError, "dynamic"),
        ({"render_mode": "rgb_aray"}, ConfigError, "rgb_array"),
    ],
)
def test_unknown_names_are_refused_with_the_nearest(
    arguments: dict[str, Any], error: type[CarlaLocError], nearest: str
) -> None:
    """One line that names what was meant."""
    with pytest.raises(error, match=f"did you mean '{nearest}'") as caught:
        CarlaLocEnv(**{"rig": "state", **arguments})
    assert "\n" not in str(caught.value)


def test_rendering_gives_a_picture() -> None:
    """`render` gives an RGB picture that is neither black nor white nor flat."""
    env = CarlaLocEnv(rig="state", render_mode="rgb_array")
    env.reset(seed=0)
    try:
        picture = env.render()
    except RenderError as error:
        pytest.skip(str(error))
    assert picture is not None
    assert picture.shape == (360, 640, 3)
    assert 30 < picture.mean() < 225
    assert picture.std() > 15
    env.close()


def test_full_throttle_into_a_wall_ends_the_episode(env: CarlaLocEnv) -> None:
    """Full throttle and full lock leave the road: the episode terminates by crash or by leaving the route."""
    env.reset(seed=2)
    terminated, steps = False, 0
    while not terminated and steps < 400:
        _, _, terminated, _, _ = env.step(np.array([0.35, 1.0, 0, 0, 0], np.float32))
        steps += 1
    assert terminated
