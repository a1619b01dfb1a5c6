"""Many environments side by side: every way of resetting, equal seeds, normalised rewards."""

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv, AutoresetMode
from shared_fixtures.drives.straight_drives import MakeEnv

import carlaloc_env  # noqa: F401  registers the environments
from carlaloc_env.core.errors import RenderError
from carlaloc_env.envs.any_town_env import AnyTownEnv
from carlaloc_env.envs.carlaloc_env import CarlaLocEnv
from carlaloc_env.weather.schedule import weather_of

try:
    import tomllib
except ModuleNotFoundError:
    import tomli as tomllib

GO = np.array([0.05, 0.4], np.float32)
ROOT = Path(__file__).parents[2]
CHILDREN = """
import sys
import gymnasium
from gymnasium.vector import AsyncVectorEnv

def make():
    return gymnasium.make("CarlaLoc-v0", map=sys.argv[2], rig="state", traffic="empty")

if __name__ == "__main__":
    import carlaloc_env
    envs = AsyncVectorEnv([make], context=sys.argv[1])
    print(envs.reset(seed=1)[0] in envs.observation_space)
    envs.close()
"""
"""A program in whose main block alone the package is imported."""
PLUGIN = """
import gymnasium, pkgutil, sys, warnings
warnings.simplefilter("error")
assert "CarlaLoc-v0" not in gymnasium.registry
for _ in range(2):
    pkgutil.resolve_name(sys.argv[1])()
print(*(name for name in gymnasium.registry if name.startswith("CarlaLoc-")))
"""
"""As Gymnasium 0.26 to 0.29 load a plugin; the second call must not warn."""
STEPS = 4
"""Length of an episode of 0.2 s."""


def _vector(map_path: Path, mode: AutoresetMode, way: str = "sync", count: int = 2) -> Any:
    return gymnasium.make_vec(
        "CarlaLoc-v0", count, way, map=str(map_path), rig="state", traffic=0.5, info=("ego", "truth"),
        task={"time_limit_s": 0.05 * STEPS}, vector_kwargs={"autoreset_mode": mode},
    )  # fmt: skip


def _driven(env: CarlaLocEnv, seed: int, steps: int = 30) -> np.ndarray[Any, Any]:
    seen = [env.reset(seed=seed)[0]]
    for k in range(steps):
        seen.append(env.step(np.array([0.05 * np.sin(k), 0.4], np.float32))[0])
    return np.array(seen)


def test_a_seed_is_the_same_after_other_episodes(make_env: MakeEnv) -> None:
    env = make_env(traffic=0.5)
    first = _driven(env, 7)
    for other in (1, 2):
        _driven(env, other, 12)
    env.reset(seed=5, options={"traffic": "static", "weather": "RainyNight"})
    env.step(GO)
    np.testing.assert_array_equal(first, _driven(env, 7))


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_vectors_reset_as_gymnasium_defines_it(mode: AutoresetMode, straight_map: Path) -> None:
    """Against one environment that is stepped and reset by hand, seeded like the first of the vector."""
    envs = _vector(straight_map, mode)
    one = CarlaLocEnv(
        map=straight_map, rig="state", traffic=0.5, info=("ego", "truth"), task={"time_limit_s": 0.05 * STEPS}
    )
    told, _ = envs.reset(seed=[7, 8])
    by_hand, _ = one.reset(seed=7)
    over = False
    for _ in range(3 * STEPS):
        np.testing.assert_array_equal(told[0], by_hand)
        if over and mode is AutoresetMode.DISABLED:
            told, _ = envs.reset(options={"reset_mask": np.array([True, True])})
            by_hand, _ = one.reset()
            np.testing.assert_array_equal(told[0], by_hand)
        told, rewards, _, truncated, info = envs.step(np.array([GO, GO]))
        if over and mode is AutoresetMode.NEXT_STEP:
            (by_hand, _), reward, over = one.reset(), 0.0, False
        else:
            by_hand, reward, _, over, _ = one.step(GO)
        assert (rewards[0], truncated[0]) == (reward, over)
        if over and mode is AutoresetMode.SAME_STEP:
            np.testing.assert_array_equal(info["final_obs"][0], by_hand)
            by_hand, _ = one.reset()
    envs.close()
    one.close()


def test_workers_drive_what_one_process_does(straight_map: Path) -> None:
    """Over resets, whatever ran in a worker before."""
    runs = []
    for way in ("sync", "async"):
        envs = _vector(straight_map, AutoresetMode.NEXT_STEP, way)
        envs.reset(seed=[1, 2])
        envs.step(np.array([GO, GO]))
        first, _ = envs.reset(seed=[7, 8])
        runs.append([first, *(envs.step(np.array([GO, GO]))[0] for _ in range(2 * STEPS))])
        envs.close()
    np.testing.assert_array_equal(*runs)


@pytest.mark.parametrize("context", ["spawn", "forkserver"])
def test_new_processes_know_the_environments_of_their_parent(
    context: str, straight_map: Path, tmp_path: Path
) -> None:
    program = tmp_path / "children.py"
    program.write_text(CHILDREN)
    command = [sys.executable, str(program), context, str(straight_map)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stdout.splitlines() == ["True"], done.stderr


@pytest.mark.parametrize("closed", [False, True])
def test_a_fork_of_a_process_that_drew_gives_an_error_at_once(
    closed: bool, make_env: MakeEnv, straight_map: Path
) -> None:
    """Not a wait for the driver's threads, which a fork lacks; new processes draw, and so does the parent."""
    env = make_env(rig="minimal")
    env.reset(seed=0)
    if closed:
        env.close()
    envs = AsyncVectorEnv([lambda: make_env(rig="minimal")], context="fork")
    begun = time.monotonic()
    with pytest.raises(RenderError, match='context="spawn"'):
        envs.reset(seed=1)
    assert time.monotonic() - begun < 5.0
    envs.close()
    if not closed:
        env.step(GO)
    any_town = AsyncVectorEnv([lambda: AnyTownEnv([straight_map], rig="minimal")], context="fork")
    with pytest.raises(RenderError, match='context="spawn"'):
        any_town.reset(seed=1)
    any_town.close()
    of_forks = AsyncVectorEnv([lambda: make_env(rig="state")], context="fork")
    of_forks.reset(seed=1)
    of_forks.close()


def test_the_entry_point_registers_all_environments_once() -> None:
    """Of pyproject.toml: the installed one may be older. `__root__` stands for ids without a prefix."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    command = [sys.executable, "-c", PLUGIN, project["entry-points"]["gymnasium.envs"]["__root__"]]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    expected = [name for name in gymnasium.registry if name.startswith("CarlaLoc-")]
    assert done.stdout.split() == expected, done.stderr


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_options_last_an_episode_and_info_names_the_one_that_runs(
    mode: AutoresetMode, straight_map: Path
) -> None:
    envs = _vector(straight_map, mode)
    route = [[20.0, -1.75], [120.0, -1.75]]
    asked = {"weather": "RainyNight", "traffic": "empty", "spawn": route[0], "goal": route[1]}
    expected = {"town": str(straight_map), "weather": "RainyNight", "traffic": "empty"}
    for info in (envs.reset(seed=[7, 8], options=asked)[1], envs.step(np.array([GO, GO]))[4]):
        assert {name: info[name][1] for name in expected} == expected
        assert json.loads(info["route"][1]) == route
    for _ in range(STEPS):
        info = envs.step(np.array([GO, GO]))[4]
    expected |= {"weather": "ClearNoon", "traffic": "0.5", "route": "town"}
    assert {name: info[name][1] for name in expected} == expected
    assert envs.envs[1].unwrapped.weather == weather_of("ClearNoon")
    envs.close()


def test_stable_baselines_normalises_and_learns(straight_map: Path, tmp_path: Path) -> None:
    """Through its own wrappers, whose statistics are saved and loaded again."""
    pytest.importorskip("stable_baselines3", reason="Stable-Baselines3 is not installed")
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    def make() -> CarlaLocEnv:
        return CarlaLocEnv(map=straight_map, rig="state", traffic="empty")

    envs = VecNormalize(DummyVecEnv([make, make]))
    model = PPO("MlpPolicy", envs, n_steps=8, batch_size=8, n_epochs=1)
    model.learn(32)
    assert envs.obs_rms.count > 32
    envs.save(str(tmp_path / "norm.pkl"))
    again = VecNormalize.load(str(tmp_path / "norm.pkl"), DummyVecEnv([make]))
    np.testing.assert_array_equal(again.obs_rms.mean, envs.obs_rms.mean)
    assert np.isfinite(again.reset()).all()
    envs.close()
    again.close()
