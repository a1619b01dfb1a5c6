"""Faults of GNSS receivers, IMUs and wheel encoders: outages, jumps, saturation and slip."""

import math
from dataclasses import dataclass, replace

import numpy as np

from carlaloc_env.core import elementary
from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.faults.fields import fault, setting
from carlaloc_env.faults.timing import Draws, MountedFaults, TimingFaults
from carlaloc_env.samples import GnssFix, Imu, Sample, WheelTicks

GYRO_RADPS_PER_K, ACCEL_MPS2_PER_K, WARM_UP_S = math.radians(0.015), 9.80665e-3, 300.0
"""Changes of biases by temperature, and the time constant of a warming IMU."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GnssFaults(MountedFaults):
    """Faults of a GNSS receiver."""

    outage_share: float = fault(
        "1", "share of the time without a fix, in bursts; samples come, without a place", worst=0.95, low=0.0,
        high=0.99,
    )  # fmt: skip
    outage_length: float = setting("fixes", "mean length of an outage", default=25.0, low=1.0)
    jump_m: float = fault(
        "m", "length of a level jump, its direction drawn for each jump", worst=100.0, low=0.0
    )
    jump_share: float = setting("1", "share of the time that is displaced by jumps", default=0.2, low=0.0)
    jump_length: float = setting("fixes", "mean length of a jump", default=25.0, low=1.0)

    def apply(self, sample: Sample, draws: Draws) -> Sample:
        """A fix of a faulty receiver, which does not notice jumps: its covariance stays."""
        if not isinstance(sample, GnssFix):
            return sample
        fix, stamp_ns = sample, sample.stamp_ns
        if draws.is_in_burst("outage", stamp_ns, self.outage_share, self.outage_length):
            return replace(
                fix, latitude_deg=math.nan, longitude_deg=math.nan, altitude_m=math.nan, has_fix=False,
                solution="none", satellites=0,
            )  # fmt: skip
        begin_ns = None
        if self.jump_m and fix.has_fix:
            begin_ns = draws.burst_begin_ns("jump", stamp_ns, min(self.jump_share, 0.99), self.jump_length)
        if begin_ns is None:
            return fix
        direction = 2.0 * math.pi * draws.at("direction", begin_ns).random()
        here = GeoReference(
            latitude_deg=fix.latitude_deg, longitude_deg=fix.longitude_deg, height_m=fix.altitude_m
        )
        east, north = self.jump_m * elementary.cos(direction), self.jump_m * elementary.sin(direction)
        latitude, longitude, _ = here.enu_to_geodetic([east, north, 0.0]).tolist()
        return replace(fix, latitude_deg=latitude, longitude_deg=longitude)


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
    warm_up_k: float = fault(
        "K", "warming by 1 − exp(−t / 300 s) of this; a kelvin moves biases by ±0.015 °/s and ±1 mg",
        worst=40.0, low=0.0, source="BMI055, by a comparison of IMUs",
    )  # fmt: skip

    def apply(self, sample: Sample, draws: Draws) -> Sample:
        """A measurement of a faulty IMU: the biased value, cut at the limits."""
        if not isinstance(sample, Imu):
            return sample
        force = sample.specific_force_mps2 + self.accel_bias_mps2
        rate = sample.angular_rate_radps + self.gyro_bias_radps
        if self.warm_up_k:
            warmer_k = self.warm_up_k * (1.0 - elementary.exp(-1e-9 * sample.stamp_ns / WARM_UP_S))
            signs = np.sign(draws.at("warm").random((2, 3)) - 0.5)
            force = force + ACCEL_MPS2_PER_K * warmer_k * signs[0]
            rate = rate + GYRO_RADPS_PER_K * warmer_k * signs[1]
        return replace(
            sample,
            specific_force_mps2=np.clip(force, -self.accel_limit_mps2, self.accel_limit_mps2),
            angular_rate_radps=np.clip(rate, -self.gyro_limit_radps, self.gyro_limit_radps),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class WheelFaults(TimingFaults):
    """Faults of wheel encoders."""

    slip: float = fault(
        "1", "rear wheels turn by this share more than their way, (ωr − v) / v", worst=0.5, low=-1.0,
        source="SAE J670",
    )  # fmt: skip

    def apply(self, sample: Sample, draws: Draws) -> Sample:
        """Counters of wheels that slip since the drive began, whole ticks rounded down."""
        if not isinstance(sample, WheelTicks):
            return sample
        gain = np.array([1.0, 1.0, 1.0 + self.slip, 1.0 + self.slip])
        ticks = np.floor(sample.ticks * gain).astype(np.int64)
        return replace(sample, ticks=ticks, rate_radps=sample.rate_radps * gain)
