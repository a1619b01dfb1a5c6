"""Readings of an IMU on the drives of `scenes`, with and without its errors."""

from typing import Any

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import TICK_NS
from carlaloc_env.samples import Imu, Sample
from carlaloc_env.sensors.imu import ImuConfig

QUIET = {
    "accel_noise_density": 0.0,
    "gyro_noise_density": 0.0,
    "accel_random_walk": 0.0,
    "gyro_random_walk": 0.0,
}


def rows(samples: list[Sample]) -> Array:
    """Specific force and body rate, one row per sample."""
    assert all(isinstance(sample, Imu) for sample in samples)
    return np.array([[*s.specific_force_mps2, *s.angular_rate_radps] for s in samples])  # type: ignore[attr-defined]


def read(scenery: Any, path: Any, seconds: float, **config: Any) -> Array:
    """All readings of a drive."""
    drive = scenery.drive(path, seconds)
    imu = ImuConfig(**config).build(scenery.world())
    stamps = [k * TICK_NS for k in range(round(seconds * 200))]
    return rows(imu.measure(drive, stamps))


def quiet_imu(**config: Any) -> Any:
    """A perfect IMU but for what is asked for."""
    return ImuConfig(**{**QUIET, **config})
