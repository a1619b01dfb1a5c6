"""What systems read beside sweeps: inertial samples and stereo pairs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import U8, Array


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuSample:
    """One inertial sample."""

    stamp_ns: int
    """Unix time [ns]."""
    acceleration_mps2: Array
    """Specific force in the IMU's axes [m/s²], shape (3,)."""
    angular_velocity_radps: Array
    """Rate of turning in the IMU's axes [rad/s], shape (3,)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoPair:
    """Two grey images of one instant."""

    stamp_ns: int
    """Unix time [ns]."""
    left: U8
    """Left image, shape (H, W)."""
    right: U8
    """Right image, shape (H, W)."""
    left_mover: NDArray[np.bool_] | None = None
    """Where the left image shows what moves by itself, painted over; None: nothing was. Shape (H, W)."""
