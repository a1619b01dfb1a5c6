"""Faults of GNSS receivers: times without a fix, and jumps of the position."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from carlaloc_env.core import elementary
from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.faults.calibration import MountedFaults
from carlaloc_env.faults.fields import fault, setting
from carlaloc_env.faults.timing import Draws
from carlaloc_env.samples import GnssFix, Sample


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
