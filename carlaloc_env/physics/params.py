"""Numbers of the ego car: an electric saloon of 4.7 × 1.85 × 1.45 m with rear drive."""

import math
from dataclasses import dataclass

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import GRAVITY_MPS2
from carlaloc_env.core.ego import (
    DEFAULT_RIDE,
    EGO_FRONT_M,
    EGO_REAR_M,
    EGO_SIZE_M,
    EGO_STEERING_RATIO,
    EGO_TRACK_M,
    EGO_TYRE_ENVELOPE_M,
    EGO_TYRE_RADIUS_M,
    EGO_WHEELBASE_M,
)
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.road.rough_surface import STANDARD_WAVINESS


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleParams:
    """Masses, springs, tyres and motors of the ego; frame `base_link` (FLU, below the rear axle).

    Values describe a mid-size electric saloon: masses and steering ratio as published for such
    cars, springs from ride frequencies, tyre curves tuned so that the manoeuvres of
    tests/physics/test_theory.py come out as measured on real cars.
    """

    mass_kg: float = 1850.0
    """Mass of the whole car."""
    unsprung_kg: float = 45.0
    """Mass that moves with a wheel, mean of the four."""
    inertia_kgm2: tuple[float, float, float] = (620.0, 2750.0, 3050.0)
    """Moments about the centre of mass: roll, pitch, yaw."""
    wheelbase_m: float = EGO_WHEELBASE_M
    """Distance between the axles."""
    track_m: float = EGO_TRACK_M
    """Distance between left and right wheel."""
    cog_x_m: float = 1.355
    """Centre of mass ahead of the rear axle."""
    cog_z_m: float = 0.48
    """Centre of mass above the ground at rest."""
    body_min_m: tuple[float, float, float] = (EGO_REAR_M, -0.5 * EGO_SIZE_M[1], 0.20)
    """Lower rear right corner of the collision box in `base_link`."""
    body_max_m: tuple[float, float, float] = (EGO_FRONT_M, 0.5 * EGO_SIZE_M[1], EGO_SIZE_M[2])
    """Upper front left corner of the collision box in `base_link`."""

    ride_hz: tuple[float, float] = (1.30, 1.45)
    """Natural frequency of the sprung mass on its springs, front and rear."""
    damping_ratio: float = 0.32
    """Damping of the sprung mass, fraction of critical."""
    anti_roll_npm: tuple[float, float] = (38e3, 14e3)
    """Force per metre of left-right difference in wheel travel, front and rear."""
    bump_stop_m: float = 0.08
    """Compression at which the bump stop takes over."""
    rebound_stop_m: float = 0.09
    """Extension at which the rebound stop takes over."""
    stop_npm: float = 200e3
    """Stiffness of both stops."""

    wheel_radius_m: float = EGO_TYRE_RADIUS_M
    """Radius of the unloaded tyre."""
    wheel_inertia_kgm2: float = 1.3
    """Spin inertia of one wheel with its share of the drive."""
    tyre_npm: float = 220e3
    """Vertical stiffness of a tyre."""
    tyre_nspm: float = 200.0
    """Vertical damping of a tyre."""
    envelope_m: float = EGO_TYRE_ENVELOPE_M
    """Outer rays of a wheel lie this far before and behind its centre."""
    smoothing_m: float = 0.10
    """Travel over which a tyre spreads a step of the road."""

    cornering_n: float = 100e3
    """Peak of the cornering stiffness over load [N/rad]."""
    cornering_load_n: float = 6500.0
    """Load at which the cornering stiffness peaks."""
    front_compliance: float = 0.66
    """Factor on the front cornering stiffness: give of steering and links."""
    slip_stiffness: float = 22.0
    """Longitudinal slip stiffness per newton of load."""
    mu_long: float = 1.15
    """Peak longitudinal friction on dry asphalt."""
    mu_lat: float = 1.02
    """Peak lateral friction on dry asphalt at `load_ref_n`."""
    mu_lat_fall: float = 0.06
    """Loss of lateral friction per relative overload."""
    load_ref_n: float = 4500.0
    """Load at which `mu_lat` holds."""
    relaxation_long_m: float = 0.25
    """Travel over which longitudinal force builds up."""
    relaxation_lat_m: float = 0.50
    """Travel over which lateral force builds up."""
    standstill_nspm: float = 2000.0
    """Damping of the tyre's shear at standstill, at `load_ref_n`."""

    power_w: float = 208e3
    """Motor power."""
    efficiency: float = 0.93
    """Share of the motor power that reaches the road."""
    drive_force_n: float = 9300.0
    """Greatest drive force of both rear wheels together."""
    reverse_force_n: float = 4500.0
    """Greatest drive force in reverse."""
    reverse_speed_mps: float = 8.0
    """Speed at which reverse drive fades out."""
    drive_lag_s: float = 0.08
    """Time constant of the motor."""
    regeneration_mps2: float = 1.5
    """Deceleration with both pedals released."""
    regeneration_fade_mps: float = 3.0
    """Speed below which that deceleration fades."""
    brake_mps2: float = 11.5
    """Deceleration that a full brake pedal asks for."""
    brake_front: float = 0.62
    """Share of the front brakes."""
    brake_lag_s: float = 0.12
    """Time constant of the brakes."""
    slip_control: float = 0.93
    """Brake and drive torque of a wheel stay below this fraction of its friction (ABS, traction control)."""
    handbrake_nm: float = 1800.0
    """Torque of the handbrake on each rear wheel."""

    drag_area_m2: float = 0.23 * 2.22
    """Drag coefficient times frontal area."""
    air_kgpm3: float = 1.2
    """Density of air."""
    rolling: float = 0.010
    """Rolling resistance per newton of load."""

    steer_max_rad: float = math.radians(35.0)
    """Road-wheel angle at full lock (of the single-track model)."""
    steering_ratio: float = EGO_STEERING_RATIO
    """Steering-wheel angle per road-wheel angle."""
    wheel_rate_radps: float = math.radians(600.0)
    """Greatest rate of the steering wheel."""

    @property
    def sprung_kg(self) -> float:
        """Mass carried by the springs."""
        return self.mass_kg - 4.0 * self.unsprung_kg

    @property
    def static_load_n(self) -> tuple[float, float]:
        """Load of one front and one rear tyre at rest on flat ground."""
        rear = 1.0 - self.cog_x_m / self.wheelbase_m
        weight = 0.5 * self.mass_kg * GRAVITY_MPS2
        return weight * (1.0 - rear), weight * rear

    @property
    def spring_npm(self) -> tuple[float, float]:
        """Rate of one front and one rear spring, from the ride frequencies."""
        front, rear = (load / GRAVITY_MPS2 * self.sprung_kg / self.mass_kg for load in self.static_load_n)
        return front * (2 * math.pi * self.ride_hz[0]) ** 2, rear * (2 * math.pi * self.ride_hz[1]) ** 2

    @property
    def damper_nspm(self) -> tuple[float, float]:
        """Rate of one front and one rear damper."""
        front, rear = (load / GRAVITY_MPS2 * self.sprung_kg / self.mass_kg for load in self.static_load_n)
        return (
            2 * self.damping_ratio * math.sqrt(self.spring_npm[0] * front),
            2 * self.damping_ratio * math.sqrt(self.spring_npm[1] * rear),
        )

    @property
    def axle_cornering_nprad(self) -> tuple[float, float]:
        """Cornering stiffness of front and rear axle at static load [N/rad]."""
        front, rear = (
            2 * self.cornering_n * float(elementary.sin(2 * elementary.arctan(load / self.cornering_load_n)))
            for load in self.static_load_n
        )
        return front * self.front_compliance, rear

    @property
    def understeer_s2pm(self) -> float:
        """Factor K of the linear single-track model, yaw rate = v·δ / (L + K·v²) [s²/m]."""
        front, rear = self.axle_cornering_nprad
        lf, lr = self.wheelbase_m - self.cog_x_m, self.cog_x_m
        return self.mass_kg / self.wheelbase_m * (lr / front - lf / rear)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ride:
    """Answer of the body to the road: the car's springs, and the spectrum of the road's short waves."""

    vehicle: VehicleParams = VehicleParams()
    """The car."""
    waviness: float = STANDARD_WAVINESS
    """Waviness of roads below 10 m."""


RIDES = {
    DEFAULT_RIDE: Ride(),
    "real": Ride(vehicle=VehicleParams(anti_roll_npm=(10.5e3, 3.0e3)), waviness=2.5),
}
"""Rides by name. In ``real``, bars give 30 % of the roll stiffness, in ``standard`` 62 %: those of a Ford
Escort give 19 %, of a BMW 320i 23 %, of a VW Vanagon 32 % (DOT's data in Althoff et al., "CommonRoad",
IV 2017). Its waviness is the middle of real roads, 1.7 to 3.3 (Mitschke and Wallentowitz, "Dynamik der
Kraftfahrzeuge"); ISO 8608's 2 gives short waves more power than most roads have."""


def ride_by_name(name: str) -> Ride:
    """One of `RIDES`.

    Raises:
        ConfigError: there is no such ride.
    """
    if name not in RIDES:
        raise ConfigError(unknown_name("ride", name, RIDES))
    return RIDES[name]
