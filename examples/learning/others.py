"""Inputs of example 19's network: the car and its road as they are, and a summary of the others."""

from typing import Any

import torch
from gymnasium import Space
from gymnasium.spaces import Box, Dict
from gymnasium.wrappers import TransformObservation
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from carlaloc_env import state_names

WIDTH = sum(name.startswith("neighbour_0_") for name in state_names())
"""Numbers of each of the others."""
COUNT = sum(name.startswith("neighbour_") for name in state_names()) // WIDTH
"""The others in the vector."""


class OwnAndOthers(BaseFeaturesExtractor):  # type: ignore[misc]
    """Inputs of the car and its road, plain and through a layer of a network, and a summary of the others.

    Another small network reads each of the others; the summary is the maximum over all of them.
    """

    def __init__(self, space: Dict, features: int = 32) -> None:
        own, width = (space[name].shape[-1] for name in ("own", "others"))  # type: ignore[index]
        super().__init__(space, own + 2 * features)
        self.itself = torch.nn.Sequential(torch.nn.Linear(own, features), torch.nn.Tanh())
        self.each = torch.nn.Sequential(
            torch.nn.Linear(width, features), torch.nn.ReLU(), torch.nn.Linear(features, features)
        )

    def forward(self, seen: dict[str, torch.Tensor]) -> torch.Tensor:
        """Numbers for the network, (..., own + 2 × features)."""
        own, others = seen["own"], self.each(seen["others"]).amax(dim=-2)
        return torch.cat([own, self.itself(own), others], dim=-1)


def apart(seen: Any) -> dict[str, Any]:
    """The vector cut into `own`, and `others`, one row each."""
    own = len(seen) - COUNT * WIDTH
    return {"own": seen[:own], "others": seen[own:].reshape(COUNT, WIDTH)}


def cut_apart(env: Any) -> Any:
    """The environment with its vector cut `apart`."""
    parts = apart(env.observation_space.sample())
    space: dict[str, Space[Any]] = {name: Box(-1.0, 1.0, part.shape) for name, part in parts.items()}
    return TransformObservation(env, apart, Dict(space))
