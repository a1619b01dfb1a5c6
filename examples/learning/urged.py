"""Costs for training, which teach an agent to start and to brake in time; noise alone does not."""

from typing import Any

from gymnasium import Wrapper

from carlaloc_env import state_names

URGE, ROLLING_MPS, FREE_M = 0.6, 2.0, 8.0
"""Cost of an action that leaves the car standing with this room ahead; rolling costs less."""
LATE, COMFORT_MPS2 = 0.4, 1.5
"""Cost of an action after which the car must brake harder than this, for each m/s²."""
SPEED, ROOM, BRAKING = (state_names().index(name) for name in ("speed", "room", "braking"))


class Urged(Wrapper[Any, Any, Any, Any]):
    """Standing without a reason costs `URGE`, and approaching too fast `LATE`.

    Random actions rarely start or stop a car: without these costs an agent learns neither.
    """

    def step(self, action: Any) -> Any:
        """One action, whose reward is less if the car stands before a free road or approaches too fast."""
        seen, reward, *rest = self.env.step(action)
        state = seen["state"] if isinstance(seen, dict) else seen
        speed_mps, room_m, braking_mps2 = 40.0 * state[SPEED], 20.0 * state[ROOM], 8.0 * state[BRAKING]
        cost = URGE * max(0.0, 1.0 - abs(speed_mps) / ROLLING_MPS) if room_m > FREE_M else 0.0
        return seen, float(reward) - cost - LATE * max(0.0, braking_mps2 - COMFORT_MPS2), *rest
