"""The pupil of example 11: a small network from numbers of the state vector to steering and pedal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from town01_route import Ride

from carlaloc_env.task.state_vector import state_names

OWN_DOING = ("yaw_rate", "road_wheel", "acceleration", "lateral_acceleration", "standing")
"""What the driver did a moment ago: a copy learns from it to go on, and not why."""
SEEN = [k for k, name in enumerate(state_names()) if name not in OWN_DOING]
"""Entries of the state vector that the pupil looks at."""
REACTION = 12
"""Actions within which one who stands drives off: why not at once, no pupil without memory can tell."""


class Pupil:
    """A network, and mean and spread of what it sees."""

    def __init__(self, rides: Sequence[Ride], seed: int = 0) -> None:
        torch.manual_seed(seed)
        seen = np.concatenate([ride.seen[:, SEEN] for ride in rides])
        self.mean, self.spread = seen.mean(axis=0), seen.std(axis=0) + np.float32(0.01)
        a, b = torch.nn.Linear(len(SEEN), 128), torch.nn.Linear(128, 64)
        self.net = torch.nn.Sequential(a, torch.nn.Tanh(), b, torch.nn.Tanh(), torch.nn.Linear(64, 2))
        self._adam = torch.optim.Adam(self.net.parameters(), 5e-4)

    def view(self, seen: NDArray[np.float32]) -> NDArray[np.float32]:
        """What the network gets of one or many observations."""
        return np.asarray(np.clip((seen[..., SEEN] - self.mean) / self.spread, -6.0, 6.0), np.float32)

    def __call__(self, seen: NDArray[np.float32]) -> NDArray[np.float32]:
        """Steering and pedal for an observation."""
        with torch.no_grad():
            found: NDArray[np.float32] = self.net(torch.as_tensor(self.view(seen))).numpy()
        return np.clip(found, -1.0, 1.0)

    def learn(self, rides: Sequence[Ride], passes: int) -> None:
        """Come nearer to what was taught; steering counts more, since it is finer."""
        kept = [_without_reactions(ride) for ride in rides]
        seen = torch.as_tensor(self.view(np.concatenate([ride.seen for ride in kept])))
        taught = torch.as_tensor(np.concatenate([ride.taught for ride in kept]))
        weight = torch.tensor([20.0, 1.0])
        for _ in range(passes):
            for rows in torch.randperm(len(seen)).split(256):
                self._adam.zero_grad()
                (weight * (self.net(seen[rows]) - taught[rows]) ** 2).mean().backward()
                self._adam.step()


def _without_reactions(ride: Ride) -> Ride:
    waits = (ride.seen[:, 0] < 0.0025) & (ride.taught[:, 1] < 0.0)
    goes = [bool((ride.taught[k + 1 : k + 1 + REACTION, 1] > 0.0).any()) for k in range(len(waits))]
    keep = ~(waits & goes)
    return ride._replace(seen=ride.seen[keep], taught=ride.taught[keep])
