"""The pupil's network as the policy of Stable-Baselines3's PPO, and back: for example 13."""

from __future__ import annotations

from typing import Any

import gymnasium
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from learning.pupil import Pupil
from learning.sight import SIZE, Sight

NOISE = torch.tensor([0.02, 0.12]).log()
"""Logarithms of the spread of steering and pedal with which PPO explores."""


class Eyes(BaseFeaturesExtractor):  # type: ignore[misc]
    """The pupil's sight, as Stable-Baselines3 asks for it."""

    def __init__(self, space: gymnasium.spaces.Box) -> None:
        super().__init__(space, SIZE)
        self.sight = Sight()

    def forward(self, seen: torch.Tensor) -> torch.Tensor:
        """Numbers for the network, (..., `SIZE`)."""
        return self.sight(seen)


def ppo_of(pupil: Pupil, env: gymnasium.Env[Any, Any], rollout: int = 2048) -> PPO:
    """PPO that begins as the pupil and learns after so many actions; its critic knows nothing yet."""
    kind = {"features_extractor_class": Eyes, "net_arch": {"pi": [128, 64], "vf": [128, 64]}}
    ppo = PPO(
        "MlpPolicy", env, n_steps=rollout, batch_size=min(rollout, 256), n_epochs=5, gamma=0.995,
        learning_rate=1e-4, clip_range=0.1, target_kl=0.02, policy_kwargs=kind, seed=0,
    )  # fmt: skip
    ppo.policy.features_extractor.sight.load_state_dict(pupil.sight.state_dict())
    ppo.policy.mlp_extractor.policy_net.load_state_dict(pupil.net[:4].state_dict())
    ppo.policy.action_net.load_state_dict(pupil.net[4].state_dict())
    ppo.policy.log_std.data.copy_(NOISE)
    return ppo


def let_policy_learn(ppo: PPO, learns: bool) -> None:
    """Whether more than the critic learns."""
    for part in (ppo.policy.mlp_extractor.policy_net, ppo.policy.action_net):
        part.requires_grad_(learns)


def give_back(ppo: PPO, pupil: Pupil) -> None:
    """Put the network of the policy into the pupil."""
    pupil.net[:4].load_state_dict(ppo.policy.mlp_extractor.policy_net.state_dict())
    pupil.net[4].load_state_dict(ppo.policy.action_net.state_dict())
