"""Faults of wheel encoders: driven wheels that slip."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from carlaloc_env.faults.fields import fault
from carlaloc_env.faults.timing import Draws, TimingFaults
from carlaloc_env.samples import Sample, WheelTicks


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
