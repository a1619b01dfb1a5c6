"""The agent of example 19: Stable-Baselines3's PPO with normalised inputs, and its file."""

from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Dict
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from learning.eyes import Eyes
from learning.others import OwnAndOthers

CHOSEN = {"n_steps": 256, "gamma": 0.97, "gae_lambda": 0.9, "learning_rate": LinearSchedule(1e-3, 1e-4, 0.9)}
"""Parameters of PPO; all others are the library's defaults. An action is credited with about the next 7 s."""
LOOKING = {**CHOSEN, "n_epochs": 5, "learning_rate": LinearSchedule(5e-4, 5e-5, 0.9)}
"""The same for an agent that sees pictures."""
POLICY = {"log_std_init": -1.2, "net_arch": {"pi": [], "vf": [64, 64]}}
"""Actions are a linear function of the inputs; their initial standard deviation is e to the power -1.2."""


def new_agent(env: VecEnv, seed: int = 0, **parameters: Any) -> PPO:
    """An untrained agent; with a plain vector as observation, the library's defaults."""
    if not isinstance(env.observation_space, Dict):
        return PPO("MlpPolicy", env, seed=seed, device="cpu", **parameters)
    seen = VecNormalize(env, norm_obs_keys=["own"], norm_reward=False, clip_obs=5.0, epsilon=0.01)
    looks = "picture" in env.observation_space.spaces
    kind = {**POLICY, "features_extractor_class": Eyes if looks else OwnAndOthers}
    settings = {**(LOOKING if looks else CHOSEN), **parameters}
    settings.setdefault("batch_size", settings["n_steps"] * env.num_envs // 4)
    return PPO("MultiInputPolicy", seen, policy_kwargs=kind, seed=seed, device="cpu", **settings)


def act(agent: PPO, seen: Any) -> NDArray[np.float32]:
    """The action that the agent thinks best."""
    inputs = agent.get_vec_normalize_env()
    known = seen if inputs is None else inputs.normalize_obs(seen)
    return np.asarray(agent.predict(known, deterministic=True)[0])


def save(agent: PPO, path: Path) -> Path:
    """Write network, and mean and variance of its inputs, and return the path."""
    inputs = agent.get_vec_normalize_env()
    known = {} if inputs is None else vars(inputs.obs_rms["own"])
    own = {name: torch.as_tensor(value) for name, value in known.items() if name != "epsilon"}
    torch.save({"policy": agent.policy.state_dict(), "own": own}, path)
    return path


def load(agent: PPO, path: Path) -> None:
    """Put a file's network and inputs into an agent of the same kind."""
    parts, inputs = torch.load(path, weights_only=True), agent.get_vec_normalize_env()
    agent.policy.load_state_dict(parts["policy"])
    for name, value in parts["own"].items():
        setattr(inputs.obs_rms["own"], name, value.numpy() if value.ndim else float(value))
