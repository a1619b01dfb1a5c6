"""Samples of the vehicle's own sensors: inertial, satellite, speed and wheels."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.samples.base import Sample, check_arrays


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Imu(Sample):
    """One inertial measurement in the IMU frame; at rest the up axis reads +9.81 m/s²."""

    specific_force_mps2: NDArray[np.float64]
    """Specific force [m/s²], frame `frame_id`, shape (3,)."""
    angular_rate_radps: NDArray[np.float64]
    """Body rate [rad/s], frame `frame_id`, shape (3,)."""
    quat_xyzw: NDArray[np.float64] | None = None
    """Attitude: maps `frame_id` to world (ENU), unit quaternion xyzw, shape (4,); None: not estimated."""
    orientation_noise_rad: float = 0.0
    """Standard deviation of the attitude per axis [rad]."""

    def __post_init__(self) -> None:
        check_arrays(self, np.float64, (3,), "specific_force_mps2", "angular_rate_radps")
        check_arrays(self, np.float64, (4,), "quat_xyzw")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class GnssFix(Sample):
    """One satellite fix on WGS84."""

    latitude_deg: float
    """Latitude [deg]."""
    longitude_deg: float
    """Longitude [deg]."""
    altitude_m: float
    """Height above the ellipsoid [m]."""
    covariance_enu_m2: NDArray[np.float64]
    """Covariance of the position, east, north, up [m²], shape (3, 3)."""
    has_fix: bool = True
    """Whether enough satellites were seen; without a fix the place is NaN."""
    solution: str = "single"
    """Kind of solution: ``none``, ``single``, or with a base station ``float`` or ``fixed``."""
    satellites: int = 0
    """Number of satellites used [1]; 0 where none are modelled."""

    def __post_init__(self) -> None:
        check_arrays(self, np.float64, (3, 3), "covariance_enu_m2")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Speed(Sample):
    """The speedometer."""

    speed_mps: float
    """Forward speed of base_link [m/s], negative backwards."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class WheelTicks(Sample):
    """Counters of the wheels: front left, front right, rear left, rear right."""

    ticks: NDArray[np.int64]
    """Ticks counted since the drive began, less when rolling back, shape (4,)."""
    rate_radps: NDArray[np.float64]
    """Spin over the last period, from the ticks in it [rad/s], shape (4,)."""
    ticks_per_turn: int
    """Ticks in one turn of a wheel [1]; 96 = two of each of 48 teeth."""

    def __post_init__(self) -> None:
        check_arrays(self, np.int64, (4,), "ticks")
        check_arrays(self, np.float64, (4,), "rate_radps")
