"""What standing without a reason costs while an agent learns."""

from __future__ import annotations

from typing import Any

from gymnasium import Wrapper

from carlaloc_env.envs.task.state_vector import state_names

URGE, ROLLING_MPS, FREE_M = 0.6, 2.0, 8.0
"""Cost of an action that leaves the car standing before so much room; rolling costs less."""
SPEED, ROOM = (state_names().index(name) for name in ("speed", "room"))


class Urged(Wrapper[Any, Any, Any, Any]):
    """Standing without a reason costs `URGE`: noise sets no braked car in motion, so it learns nothing."""

    def step(self, action: Any) -> Any:
        """One action, whose reward is less if the car stands though the road ahead is free."""
        seen, reward, *rest = self.env.step(action)
        own = seen["own"] if isinstance(seen, dict) else seen
        speed_mps, room_m = 40.0 * own[SPEED], 20.0 * own[ROOM]
        cost = URGE * max(0.0, 1.0 - abs(speed_mps) / ROLLING_MPS) if room_m > FREE_M else 0.0
        return seen, float(reward) - cost, *rest
