"""Faults of IMUs: saturation and steps of the bias; missing samples are faults of time."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from carlaloc_env.faults.fields import fault
from carlaloc_env.faults.timing import Draws, TimingFaults
from carlaloc_env.samples import Imu, Sample


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuFaults(TimingFaults):
    """Faults of an IMU; its place is the origin of all calibration, and never wrong."""

    accel_limit_mps2: float = fault(
        "m/s²", "each axis of the specific force is cut at ± this", neutral=math.inf, worst=9.9, low=0.0
    )
    gyro_limit_radps: float = fault(
        "rad/s", "each axis of the body rate is cut at ± this", neutral=math.inf, worst=0.05, low=0.0
    )
    accel_bias_mps2: float = fault(
        "m/s²", "added to each axis from `begin_s` on, a step of the bias", worst=1.0
    )
    gyro_bias_radps: float = fault("rad/s", "added to each axis from `begin_s` on", worst=0.1)

    def apply(self, sample: Sample, draws: Draws) -> Sample:
        """A measurement of a faulty IMU: the biased value, cut at the limits."""
        if not isinstance(sample, Imu):
            return sample
        force = sample.specific_force_mps2 + self.accel_bias_mps2
        rate = sample.angular_rate_radps + self.gyro_bias_radps
        return replace(
            sample,
            specific_force_mps2=np.clip(force, -self.accel_limit_mps2, self.accel_limit_mps2),
            angular_rate_radps=np.clip(rate, -self.gyro_limit_radps, self.gyro_limit_radps),
        )
