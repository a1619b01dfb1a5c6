"""The ego car: its dimensions, which all parts read here, and the controls that every device gives.

Its frame `base_link` is FLU, on the ground below the middle of the rear axle.
"""

from __future__ import annotations

from dataclasses import dataclass

from carlaloc_env.core.errors import ActionError

EGO_SIZE_M = (4.70, 1.85, 1.45)
"""Length, width, height of the ego's body [m]."""
EGO_REAR_M = -0.95
"""Where the ego's body begins along x of `base_link` [m]."""
EGO_FRONT_M = EGO_REAR_M + EGO_SIZE_M[0]
"""Where the ego's front bumper ends along x of `base_link` [m]."""
EGO_CENTRE_M = EGO_REAR_M + 0.5 * EGO_SIZE_M[0]
"""Where the middle of the ego's body lies along x of `base_link` [m]."""
EGO_WHEELBASE_M = 2.875
"""Distance between the ego's axles [m]."""
EGO_TRACK_M = 1.58
"""Distance between the middles of the ego's left and right tyres [m]."""
EGO_TYRE_OUTER_M = 0.89
"""Distance from the ego's middle to the outer side of its tyres [m]: half the track, half a tyre."""
EGO_TYRE_ENVELOPE_M = 0.17
"""How far before and behind its hub a tyre touches a step of the road first [m]."""
EGO_TYRE_RADIUS_M = 0.334
"""Radius of the ego's unloaded tyres [m]; under their static load they stand 0.02 m lower."""
EGO_ROLLING_RADIUS_M = 0.311
"""Rolling radius of the ego's wheels under load [m]: distance covered per radian of a wheel's turning."""
EGO_STEERING_RATIO = 12.0
"""Steering-wheel angle per road-wheel angle of the ego."""
DEFAULT_RIDE = "standard"
"""Name of the ride of drives that name none (`physics.params.RIDES`)."""


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
