"""The picture from above as example 19 sees it with `--sees bev`, and a small network for it."""

from typing import Any

import numpy as np
import torch
from gymnasium import Space
from gymnasium.spaces import Box, Dict
from gymnasium.wrappers import TransformObservation
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from carlaloc_env import state_names

SHOWN = [2, 3, 4]
"""Channels of the picture that the network reads (route, actors, lights), each pixel the mean of four."""
SIZE = 48
OWN_NAMES = ("speed", "yaw_rate", "road_wheel", "acceleration", "speed_limit", "speed_over_limit", "standing")
"""Entries of the state vector that it also reads: none shows the route or others."""
OWN = [state_names().index(name) for name in OWN_NAMES]


class Eyes(BaseFeaturesExtractor):  # type: ignore[misc]
    """Numbers from `picture` by three layers of convolutions, beside those of `own`."""

    def __init__(self, space: Dict, features: int = 64) -> None:
        own = space["own"].shape[0]  # type: ignore[index]
        super().__init__(space, own + features)
        layers = [(3, 16, 5), (16, 32, 3), (32, 32, 3)]
        convolved = [
            part for a, b, k in layers for part in (torch.nn.Conv2d(a, b, k, 2, k // 2), torch.nn.ReLU())
        ]
        flat = torch.nn.Linear(layers[-1][1] * (SIZE // 8) ** 2, features)
        self.look = torch.nn.Sequential(*convolved, torch.nn.Flatten(), flat, torch.nn.Tanh())

    def forward(self, seen: dict[str, torch.Tensor]) -> torch.Tensor:
        """Numbers for the network, (..., own + features)."""
        return torch.cat([seen["own"], self.look(seen["picture"])], dim=-1)


def with_eyes(env: Any, blind: bool) -> Any:
    """An environment of the rig `bev` that shows `picture` and `own`; to the blind, pictures are black."""
    shape = (len(SHOWN), SIZE, SIZE)
    space: dict[str, Space[Any]] = {
        "own": Box(-1.0, 1.0, (len(OWN),)),
        "picture": Box(0, 255, shape, np.uint8),
    }

    def look(seen: Any) -> dict[str, Any]:
        fours = seen["bev"][..., SHOWN].reshape(SIZE, 2, SIZE, 2, len(SHOWN))
        picture = np.moveaxis(fours.mean(axis=(1, 3)), -1, 0).astype(np.uint8)
        return {"own": seen["state"][OWN], "picture": picture * (not blind)}

    return TransformObservation(env, look, Dict(space))
