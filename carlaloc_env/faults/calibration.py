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


def believed(config: SensorConfig, faults: MountedFaults) -> SensorConfig:
    """The configuration that calibration files and readers show of a sensor."""
    moved = (faults.calib_x_m, faults.calib_y_m, faults.calib_z_m)
    turned = (faults.calib_roll_deg, faults.calib_pitch_deg, faults.calib_yaw_deg)
    place: Any = tuple(a + b for a, b in zip(config.mount.position_m, moved, strict=True))
    turn: Any = tuple(a + b for a, b in zip(config.mount.rpy_deg, turned, strict=True))
    changes: dict[str, Any] = {"mount": replace(config.mount, position_m=place, rpy_deg=turn)}
    focal, centre_px = getattr(faults, "calib_focal_share", 0.0), getattr(faults, "calib_centre_px", 0.0)
    if focal or centre_px:
        lens: Any = getattr(config, "pinhole")  # noqa: B009
        scaled = {name: getattr(lens, name) * (1.0 + focal) for name in ("fx_px", "fy_px")}
        changes["pinhole"] = replace(lens, **scaled, cx_px=lens.cx_px + centre_px)
    return replace(config, **changes)
