"""Learn to drive from the picture from above by PPO, beside an agent that is blind to it.

`python examples/22_learn_from_pictures.py out` learns Town01's route, and `--blind` with black pictures.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from learning.drive_env import MILD, drive_env, logged
from learning.eyes import Eyes, with_eyes
from learning.score import UNSEEN, by_agent, report

PARAMETERS = {"n_steps": 1024, "batch_size": 128, "n_epochs": 5, "learning_rate": 5e-4, "gamma": 0.99}
"""Parameters of PPO; all others are the library's defaults."""
POLICY = {"log_std_init": -1.2, "net_arch": {"pi": [], "vf": [64]}, "features_extractor_class": Eyes}
KEPT = 5_000
"""Actions after which the agent is saved."""


def main(
    out: Path, town: str = "Town01", blind: bool = False, steps: int = 80_000, seed: int = 0,
    scored: int = 10, time_limit_s: float = 100.0, **parameters: float,
) -> float:  # fmt: skip
    """Learn for a number of actions, save the agent, and return its route completion."""
    torch.set_num_threads(1)
    out.mkdir(parents=True, exist_ok=True)
    kind: dict[str, Any] = {"towns": (town,), "apart": False, "rig": "bev"}
    task = {"time_limit_s": time_limit_s, **MILD}
    rides = partial(logged, out / "rides", start="anywhere", task=task, **kind)
    seen = VecNormalize(DummyVecEnv([lambda: with_eyes(rides(), blind)]), norm_obs_keys=["own"], norm_reward=False)
    agent = PPO("MultiInputPolicy", seen, policy_kwargs=POLICY, seed=seed, device="cpu", **{**PARAMETERS, **parameters})
    seen.seed(1000 * seed)
    for done in range(0, steps, KEPT):
        agent.learn(min(KEPT, steps - done), reset_num_timesteps=False)
        agent.save(out / "agent.zip")
        seen.save(str(out / "inputs.pkl"))
    scoring = with_eyes(drive_env(**kind, task={"time_limit_s": 6.0 * time_limit_s}), blind)
    act = lambda one: agent.predict(seen.normalize_obs(one), deterministic=True)[0]
    return report(town, [by_agent(scoring, act, one) for one in UNSEEN[:scored]])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(argument_default=argparse.SUPPRESS)
    parser.add_argument("out", type=Path)
    parser.add_argument("--blind", action="store_true")
    for name in ("steps", "seed", "scored"):
        parser.add_argument(f"--{name}", type=int)
    main(**vars(parser.parse_args()))
