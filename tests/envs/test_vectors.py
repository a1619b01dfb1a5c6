"""Many environments side by side: every way of resetting, equal seeds, normalised rewards."""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from shared_fixtures.drives.straight_drives import MakeEnv

import carlaloc_env  # noqa: F401  registers the environments
from carlaloc_env.envs.carlaloc_env import CarlaLocEnv

GO = np.array([0.05, 0.4], np.float32)
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
