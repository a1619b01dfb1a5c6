"""Inputs of the pupil of examples 11 to 13 from the state vector."""

import torch

from carlaloc_env import state_entries

OWN_DOING = ("yaw_rate", "road_wheel", "acceleration", "lateral_acceleration", "standing")
"""Effects of the driver's last actions: from these, a copy learns to repeat them, without their reason."""
OWN_SUMS = ("room", "braking", "safe_speed", "corner_speed")
"""The pupil computes these itself, separately for the leader and for the line."""
ENTRIES = state_entries()
NAMES = list(ENTRIES)
SEEN = [k for k, name in enumerate(NAMES) if name not in (*OWN_DOING, *OWN_SUMS)]
"""Entries of the state vector that the pupil looks at."""
NEAR_M = (8.0, 25.0)
"""Further scales of distances: on a scale of 100 m, 1 m and 3 m before the bumper are hardly different."""


class Sight(torch.nn.Module):  # type: ignore[misc]
    """Inputs of the network from observations (..., state): entries, near distances and needed brakings."""

    mean: torch.Tensor
    spread: torch.Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(SIZE))
        self.register_buffer("spread", torch.ones(SIZE))

    def fit(self, seen: torch.Tensor) -> None:
        """Store mean and standard deviation of observations, shape (N, state)."""
        numbers = _numbers(seen)
        self.mean.copy_(numbers.mean(dim=0))
        self.spread.copy_(numbers.std(dim=0) + 0.01)

    def forward(self, seen: torch.Tensor) -> torch.Tensor:
        """Numbers for the network, (..., `SIZE`)."""
        return ((_numbers(seen) - self.mean) / self.spread).clamp(-6.0, 6.0)


def _numbers(seen: torch.Tensor) -> torch.Tensor:
    of = {name: seen[..., k] * entry.scale for k, (name, entry) in enumerate(ENTRIES.items())}
    gap_m, light_m = of["gap"], of["light_distance"]
    near = [(distance / reach).clamp(-1.0, 1.0) for distance in (gap_m, light_m) for reach in NEAR_M]
    behind = of["gap_closing"].clamp(min=0.0) ** 2 / (2.0 * (gap_m - 1.0).clamp(min=0.5))
    stop = of["light_red"] + of["light_yellow"]
    at_line = stop * of["speed"] ** 2 / (2.0 * light_m.clamp(min=0.5))
    # Braking [m/s²] that avoids the one ahead, and the one that stops at the line, over 5 m/s².
    brakings = [(braking / 5.0).clamp(max=2.0) for braking in (behind, at_line)]
    return torch.cat([seen[..., SEEN], torch.stack([*near, *brakings], dim=-1)], dim=-1)


SIZE = _numbers(torch.zeros(len(NAMES))).numel()
"""Numbers that the network gets."""
