"""Wheels, car and drive as records that compiled functions read and write."""

from dataclasses import fields
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import GRAVITY_MPS2, Array
from carlaloc_env.physics.params import VehicleParams

_FIXED = (
    "x", "y", "radius_m", "hub_z", "preload_n", "unsprung_kg", "spring_npm", "damper_nspm", "compliance",
)  # fmt: skip
"""Of a wheel, for ever: its place about the centre of mass [m], rolling radius, height of its hub at rest
[m], spring's force at rest, unsprung mass, rates of spring and damper, factor on its cornering stiffness."""
_STATE = (
    "travel_m", "speed_z", "spin_radps", "load_n", "on_road", "height_m", "normal_x", "normal_y", "normal_z",
    "hub_x", "hub_y", "hub_z_world", "shear_long_m", "shear_lat_m", "force_long_n", "force_lat_n",
    "force_x", "force_y", "force_spring", "contact_z",
)  # fmt: skip
"""Of a wheel, from tick to tick: compression from rest [m], absolute speed of the hub along the body's z axis
[m/s], spin [rad/s], force on the tyre [N], whether a road is known, its height [m] and normal, the hub in the
world [m], the tyre's shear [m] and forces [N], forces on the body [N] and where they act along z [m]."""
WHEEL = np.dtype([(name, np.float64) for name in (*_FIXED, *_STATE)])
"""Record of one wheel; vectors in body axes about the centre of mass."""
_OF_PARAMS = tuple(field.name for field in fields(VehicleParams) if isinstance(field.default, float))
CAR = np.dtype([(name, np.float64) for name in (*_OF_PARAMS, "sprung_kg", "bar_front", "bar_rear", "drop_m")])
"""Record of the car: numbers of `VehicleParams`, rates of the anti-roll bars, and how much lower the outer
rays of a wheel's envelope meet a flat road [m]."""
DRIVE = np.dtype([(name, np.float64) for name in ("steer_rad", "motor_n", "brake_n", "handbrake_nm", "mu")])
"""Record of what steering, motor and brakes do to the wheels: angle of the front wheels of the single-track
model, left positive [rad], force of the motor at the rear wheels, > 0 forwards [N], force that the brakes of
all wheels ask for together [N], handbrake torque on each rear wheel [N m], factor on the friction."""
Wheels = NDArray[Any]
"""Four records of `WHEEL`: front left, front right, rear left, rear right."""
Car = NDArray[Any]
"""One record of `CAR`, shape (1,)."""
PLACES = 3
"""Places below a wheel at which the road is looked for: rear, centre, front."""


class CarTables(NamedTuple):
    """The car for compiled functions."""

    car: Car
    """Its numbers."""
    wheels: Wheels
    """Its wheels."""
    drive: NDArray[Any]
    """One record of `DRIVE`, shape (1,)."""
    hits: Array
    """Room for what is found under the wheels, shape (4, PLACES, 5)."""
    push: Array
    """Force [N] and torque [N m] on the body, body axes, shape (6,)."""


def car_tables(p: VehicleParams) -> CarTables:
    """The car at rest on flat ground."""
    return CarTables(
        _car_record(p), _wheel_table(p), np.zeros(1, DRIVE), np.zeros((4, PLACES, 5)), np.zeros(6)
    )


def _wheel_table(p: VehicleParams) -> Wheels:
    """The four wheels at rest on flat ground."""
    wheels = np.zeros(4, WHEEL)
    for wheel, (axle, side) in zip(wheels, ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)), strict=True):
        load = p.static_load_n[axle]
        wheel["x"] = (0.0 if axle else p.wheelbase_m) - p.cog_x_m
        wheel["y"] = 0.5 * p.track_m * side
        wheel["radius_m"] = p.wheel_radius_m - load / p.tyre_npm
        wheel["hub_z"] = wheel["radius_m"] - p.cog_z_m
        # Unsprung mass in proportion to the load keeps the sprung mass's centre at the car's centre.
        wheel["preload_n"] = load * p.sprung_kg / p.mass_kg
        wheel["unsprung_kg"] = (load - wheel["preload_n"]) / GRAVITY_MPS2
        wheel["spring_npm"], wheel["damper_nspm"] = p.spring_npm[axle], p.damper_nspm[axle]
        wheel["compliance"] = 1.0 if axle else p.front_compliance
    settle(wheels)
    return wheels


def settle(wheels: Wheels) -> None:
    """Set the wheels to their state at rest on flat ground."""
    for name in _STATE:
        wheels[name] = 0.0
    wheels["load_n"] = wheels["preload_n"]
    wheels["normal_z"] = 1.0


def _car_record(p: VehicleParams) -> Car:
    """The car."""
    car = np.zeros(1, CAR)
    for name in _OF_PARAMS:
        car[name] = getattr(p, name)
    car["sprung_kg"] = p.sprung_kg
    car["bar_front"], car["bar_rear"] = p.anti_roll_npm
    car["drop_m"] = p.wheel_radius_m - sqrt(p.wheel_radius_m**2 - p.envelope_m**2)
    return car
