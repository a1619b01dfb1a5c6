"""The pupil of examples 11 to 13: a small network from numbers of the state vector to steering and pedal."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from learning.reactions import without_reactions
from learning.sight import SIZE, Sight
from learning.town01_route import Ride


class Pupil:
    """A network, and its inputs from an observation."""

    def __init__(self) -> None:
        torch.manual_seed(0)
        self.sight = Sight()
        a, b, c = torch.nn.Linear(SIZE, 128), torch.nn.Linear(128, 64), torch.nn.Linear(64, 2)
        self.net = torch.nn.Sequential(a, torch.nn.Tanh(), b, torch.nn.Tanh(), c)
        self._adam = torch.optim.Adam(self.net.parameters(), 5e-4)

    @classmethod
    def load(cls, path: Path) -> Pupil:
        """The pupil of a file that `save` wrote."""
        pupil, parts = cls(), torch.load(path, weights_only=True)
        pupil.sight.load_state_dict(parts["sight"])
        pupil.net.load_state_dict(parts["net"])
        return pupil

    def save(self, path: Path) -> None:
        """Write sight and network."""
        torch.save({"sight": self.sight.state_dict(), "net": self.net.state_dict()}, path)

    def __call__(self, seen: NDArray[np.float32]) -> NDArray[np.float32]:
        """Steering and pedal for an observation."""
        with torch.no_grad():
            found: NDArray[np.float32] = self.net(self.sight(torch.as_tensor(seen))).numpy()
        return np.clip(found, -1.0, 1.0)

    def learn(self, rides: Sequence[Ride], passes: int, rate: float = 5e-4) -> None:
        """Come nearer to the teacher's actions; steering counts more, since it is finer."""
        kept = [without_reactions(ride) for ride in rides]
        seen = self.sight(torch.as_tensor(np.concatenate([ride.seen for ride in kept])))
        taught = torch.as_tensor(np.concatenate([ride.taught for ride in kept]))
        weight = torch.tensor([20.0, 1.0])
        self._adam.param_groups[0]["lr"] = rate
        for _ in range(passes):
            for rows in torch.randperm(len(seen)).split(256):
                self._adam.zero_grad()
                (weight * (self.net(seen[rows]) - taught[rows]) ** 2).mean().backward()
                self._adam.step()
