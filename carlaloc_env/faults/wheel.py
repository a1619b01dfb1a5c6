"""Faults of wheel encoders: driven wheels that slip."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from carlaloc_env.faults.fields import fault
from carlaloc_env.faults.timing import TimingFaults
from carlaloc_env.samples import WheelTicks


@dataclass(frozen=True, slots=True, kw_only=True)
class WheelFaults(TimingFaults):
    """Faults of wheel encoders."""

    slip: float = fault(
        "1", "rear wheels turn by this share more than their way, (ωr − v) / v", worst=0.5, low=-1.0,
        source="SAE J670",
    )  # fmt: skip


def faulty_ticks(sample: WheelTicks, faults: WheelFaults) -> WheelTicks:
    """Counters of wheels that slip since the drive began, whole ticks rounded down."""
    gain = np.array([1.0, 1.0, 1.0 + faults.slip, 1.0 + faults.slip])
    return replace(
        sample,
        ticks=np.floor(sample.ticks * gain).astype(np.int64),
        rate_radps=sample.rate_radps * gain,
    )
