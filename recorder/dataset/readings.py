"""Sensor data as SLAM systems read them, and the protocol of their sources: a folder's files, or a drive."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import U8, Array

if TYPE_CHECKING:
    from recorder.dataset.scans import Scan


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuSample:
    """An inertial sample."""

    stamp_ns: int
    """Unix time [ns]."""
    acceleration_mps2: Array
    """Specific force in the IMU's axes [m/s²], shape (3,)."""
    angular_velocity_radps: Array
    """Rate of turning in the IMU's axes [rad/s], shape (3,)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoPair:
    """Two grey images of the same instant."""

    stamp_ns: int
    """Unix time [ns]."""
    left: U8
    """Left image, shape (H, W)."""
    right: U8
    """Right image, shape (H, W)."""
    left_mover: NDArray[np.bool_] | None = None
    """Where movers of the left image are painted over; None: nowhere. Shape (H, W)."""


class Readings(Protocol):
    """Sensor data of a sequence in the order of time.

    All methods raise `EvaluationError` where the sequence lacks the requested data.
    """

    @property
    def bag(self) -> Path:
        """A bag of it, of any format."""

    @property
    def euroc(self) -> Path:
        """A folder ``mav0`` of it."""

    @property
    def cloud_topic(self) -> str:
        """Topic of the LiDAR's clouds in the bag."""

    def scan_count(self) -> int:
        """Number of sweeps."""

    def scans(self) -> Iterator[Scan]:
        """All sweeps, labelled where there are labels."""

    def imu_samples(self) -> Iterator[ImuSample]:
        """All inertial samples."""

    def image_stamps(self) -> NDArray[np.int64]:
        """Unix times of the images of the left camera [ns], shape (N,)."""

    def stereo_pairs(self, *, without_movers: bool) -> Iterator[StereoPair]:
        """All pairs of grey images, on request with movers painted over."""
