"""Drivetrain: from steering wheel and pedals to the wheels by steering, motor, regeneration and brakes."""

from typing import Any

from carlaloc_env.core.clock import TICK_S
from carlaloc_env.core.jit import compiled

Pedals = tuple[float, float, float, bool, bool]
"""Steering, throttle, brake, reverse and handbrake, as in `Controls`."""


def motor_force_n(params: Any, throttle: float, speed_mps: float, reverse: bool = False) -> float:
    """Steady motor force at the wheels [N] for a pedal position 0–1 and a forward speed [m/s].

    Released pedals regenerate: the motor force runs from full drive to full regeneration over the
    throttle's travel, so a steady speed needs about a quarter of it, as in electric cars.

    `params` are `VehicleParams`, or a record of `CAR`.
    """
    p = params
    along = -speed_mps if reverse else speed_mps
    if reverse:
        limit = p.reverse_force_n * min(1.0, max(0.0, 0.5 * (p.reverse_speed_mps - along)))
    else:
        limit = p.drive_force_n
    limit = min(limit, p.power_w * p.efficiency / max(1.0, along))
    fade = max(-1.0, min(1.0, along / p.regeneration_fade_mps))
    force: float = throttle * limit - (1.0 - throttle) * fade * p.regeneration_mps2 * p.mass_kg
    return -force if reverse else force


_motor_force_n = compiled(motor_force_n)


@compiled
def advance_drive(drive: Any, car: Any, pedals: Pedals, friction: float, speed_mps: float) -> None:
    """Advance steering, motor and brakes with their lags by one tick.

    Args:
        drive: Record of `DRIVE`.
        car: Record of `CAR`.
        pedals: What the driver does.
        friction: Factor on the friction of the standing car, 1 = dry asphalt.
        speed_mps: Forward speed [m/s].
    """
    steer, throttle, brake, reverse, handbrake = pedals
    most = car.wheel_rate_radps / car.steering_ratio * TICK_S
    drive.steer_rad += max(-most, min(most, steer * car.steer_max_rad - drive.steer_rad))
    wanted = _motor_force_n(car, throttle, speed_mps, reverse)
    drive.motor_n += (wanted - drive.motor_n) * TICK_S / car.drive_lag_s
    asked = brake * car.brake_mps2 * car.mass_kg
    drive.brake_n += (asked - drive.brake_n) * TICK_S / car.brake_lag_s
    drive.handbrake_nm = car.handbrake_nm if handbrake else 0.0
    drive.mu = _wet_at_speed(friction, speed_mps)


@compiled
def _wet_at_speed(mu_factor: float, speed_mps: float) -> float:
    """Friction factor at a speed [m/s]: 0.75 in the wet falls to 0.6 at 100 km/h, dry stays dry."""
    if mu_factor >= 1.0:
        return mu_factor
    return mu_factor * (1.0 - 0.8 * (1.0 - mu_factor) * min(1.0, abs(speed_mps) / 27.8))
