"""Control of wheel and pedals towards a curvature and a speed, for actions of the kind `ackermann`."""

from math import atan
from typing import NamedTuple

from carlaloc_env.core.ego import Controls
from carlaloc_env.envs.task.task_world import TaskWorld
from carlaloc_env.physics.drivetrain import motor_force_n
from carlaloc_env.physics.params import VehicleParams

SHARPEST_PER_M = 0.2
"""Curvature of a full steering action at low speed [1/m]: a turn of 5 m; at full lock it is 4.1 m."""
LATERAL_MPS2 = 3.0
"""Lateral acceleration of a full steering action at higher speeds [m/s²]."""
ACCELERATION_MPS2, DECELERATION_MPS2 = 2.5, 8.0
"""Limits of what the pedals ask for [m/s²]."""
_GAIN_PER_S = 1.2
"""Acceleration for a metre a second that the car is too slow."""
_CREEP_MPS, _HELD = 0.3, 0.3
"""Speed below which a car that shall stand is held by the brake, and the brake pedal that holds it."""


class Motion(NamedTuple):
    """Motion of the car, and the limit that it is under."""

    speed_mps: float = 0.0
    """Forward speed [m/s]."""
    speed_limit_mps: float = 0.0
    """Speed limit here [m/s]."""


AT_REST = Motion()
"""A standing car."""


def motion_of(world: TaskWorld) -> Motion:
    """Motion of a drive's car now."""
    row = world.route.row_at(world.route_s_m)
    return Motion(speed_mps=world.state.speed_mps, speed_limit_mps=float(world.route.speed_limit_mps[row]))


def controls_towards(steer: float, speed: float, motion: Motion, p: VehicleParams) -> Controls:
    """Controls that lead to a curvature and a speed.

    Steering is that of the kinematic single-track model, atan(wheelbase times curvature). Speed is held by
    a proportional controller over the motor's force.

    Args:
        steer: Share of the sharpest curvature, -1 right to 1 left.
        speed: Wanted speed: -1 stands, 1 is the limit.
        motion: The car's motion now.
        p: Numbers of the car.
    """
    v = motion.speed_mps
    curvature = steer * min(SHARPEST_PER_M, LATERAL_MPS2 / max(v * v, 1.0))
    wheel = atan(p.wheelbase_m * curvature) / p.steer_max_rad
    wanted_mps = 0.5 * (1.0 + speed) * motion.speed_limit_mps
    asked = max(-DECELERATION_MPS2, min(_GAIN_PER_S * (wanted_mps - v), ACCELERATION_MPS2))
    # The motor's force runs from full drive to full regeneration over the throttle's travel.
    full, coast = (motor_force_n(p, pedal, v) / p.mass_kg for pedal in (1.0, 0.0))
    throttle, brake = (asked - coast) / (full - coast), (coast - asked) / p.brake_mps2
    if wanted_mps < _CREEP_MPS and v < _CREEP_MPS:
        throttle, brake = 0.0, _HELD
    throttle, brake = min(max(throttle, 0.0), 1.0), min(max(brake, 0.0), 1.0)
    return Controls(steer=max(-1.0, min(wheel, 1.0)), throttle=throttle, brake=brake)
