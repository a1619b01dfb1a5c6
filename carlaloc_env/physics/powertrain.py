"""From pedals to forces at the wheels: motor, regeneration, brakes, handbrake."""

from __future__ import annotations

from carlaloc_env.core.clock import TICK_S
from carlaloc_env.core.controls import Controls
from carlaloc_env.physics.params import VehicleParams


class Powertrain:
    """Motor and brakes with their lags.

    Released pedals regenerate: the motor force runs from full drive to full regeneration over the
    throttle's travel, so a steady speed needs about a quarter of it, as in electric cars.
    """

    __slots__ = ("_params", "brake_n", "handbrake_nm", "motor_n")

    def __init__(self, params: VehicleParams) -> None:
        self._params = params
        self.release()

    def release(self) -> None:
        """Bring motor and brakes to rest."""
        self.motor_n = 0.0
        """Force of the motor at the wheels [N]; > 0 drives forwards, < 0 backwards or regenerates."""
        self.brake_n = 0.0
        """Force that the brakes of all wheels ask for together [N]."""
        self.handbrake_nm = 0.0
        """Handbrake torque on each rear wheel [N m]."""

    def update(self, controls: Controls, speed_mps: float) -> None:
        """Advance by one tick at a forward speed [m/s]."""
        p = self._params
        wanted = motor_force_n(p, controls.throttle, speed_mps, reverse=controls.reverse)
        self.motor_n += (wanted - self.motor_n) * TICK_S / p.drive_lag_s
        asked = controls.brake * p.brake_mps2 * p.mass_kg
        self.brake_n += (asked - self.brake_n) * TICK_S / p.brake_lag_s
        self.handbrake_nm = p.handbrake_nm if controls.handbrake else 0.0


def motor_force_n(
    params: VehicleParams, throttle: float, speed_mps: float, *, reverse: bool = False
) -> float:
    """Steady motor force at the wheels [N] for a pedal position 0–1 and a forward speed [m/s]."""
    p = params
    along = -speed_mps if reverse else speed_mps
    if reverse:
        limit = p.reverse_force_n * min(1.0, max(0.0, 0.5 * (p.reverse_speed_mps - along)))
    else:
        limit = p.drive_force_n
    limit = min(limit, p.power_w * p.efficiency / max(1.0, along))
    fade = max(-1.0, min(1.0, along / p.regeneration_fade_mps))
    force = throttle * limit - (1.0 - throttle) * fade * p.regeneration_mps2 * p.mass_kg
    return -force if reverse else force
