"""What a driver does: the five controls that every device gives and the physics takes."""

from __future__ import annotations

from dataclasses import dataclass

from carlaloc_env.core.errors import ActionError


@dataclass(frozen=True, slots=True, kw_only=True)
class Controls:
    """Controls of the ego at one tick."""

    steer: float = 0.0
    """Steering, −1 (full right) to +1 (full left), fraction of the full road-wheel angle."""
    throttle: float = 0.0
    """Throttle pedal 0–1."""
    brake: float = 0.0
    """Brake pedal 0–1."""
    reverse: bool = False
    """Whether the reverse gear is engaged."""
    handbrake: bool = False
    """Whether the handbrake is pulled."""

    def checked(self) -> Controls:
        """The same controls, known to be finite and in range.

        Raises:
            ActionError: a value is NaN, infinite or out of range.
        """
        if -1.0 <= self.steer <= 1.0 and 0.0 <= self.throttle <= 1.0 and 0.0 <= self.brake <= 1.0:
            return self
        low_of = {"steer": -1.0, "throttle": 0.0, "brake": 0.0}
        name = next(name for name, low in low_of.items() if not low <= getattr(self, name) <= 1.0)
        raise ActionError(f"{name} is {getattr(self, name)}; give a finite number from {low_of[name]:g} to 1")
