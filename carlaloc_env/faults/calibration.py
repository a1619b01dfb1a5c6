"""Faults of calibration: what is written of a sensor's place and lens, while its data stay as they are."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from carlaloc_env.faults.fields import fault
from carlaloc_env.faults.timing import TimingFaults
from carlaloc_env.sensors.base import SensorConfig

PREFIX = "calib_"
"""Beginning of the names of all faults of calibration."""
_PLACE = "added to the written mount, along the car's {} axis"
_TURN = "added to the written {} of the mount"


@dataclass(frozen=True, slots=True, kw_only=True)
class MountedFaults(TimingFaults):
    """Faults of a sensor whose place on the car is calibrated against the IMU."""

    calib_x_m: float = fault("m", _PLACE.format("forward"), worst=0.5)
    calib_y_m: float = fault("m", _PLACE.format("left"), worst=0.5)
    calib_z_m: float = fault("m", _PLACE.format("upward"), worst=0.5)
    calib_roll_deg: float = fault("deg", _TURN.format("roll"), worst=10.0)
    calib_pitch_deg: float = fault("deg", _TURN.format("pitch"), worst=10.0)
    calib_yaw_deg: float = fault("deg", _TURN.format("yaw"), worst=10.0)

    def believed(self, config: SensorConfig) -> SensorConfig:
        """The configuration with the written mount."""
        moved = (self.calib_x_m, self.calib_y_m, self.calib_z_m)
        turned = (self.calib_roll_deg, self.calib_pitch_deg, self.calib_yaw_deg)
        place: Any = tuple(a + b for a, b in zip(config.mount.position_m, moved, strict=True))
        turn: Any = tuple(a + b for a, b in zip(config.mount.rpy_deg, turned, strict=True))
        return replace(config, mount=replace(config.mount, position_m=place, rpy_deg=turn))
