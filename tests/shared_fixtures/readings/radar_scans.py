"""Radar scans: configurations, and frames of a drive."""

import dataclasses
from typing import Any

from carlaloc_env.samples import RadarScan
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.radar_config import RadarConfig

HEIGHT = 0.75
"""Height of the radar above the ground [m]."""

STEP = 50_000_000
"""Period of a radar [ns]."""


def config(**changes: Any) -> RadarConfig:
    """A radar at the origin of the car, without clutter and ghosts."""
    plain = RadarConfig(mount=Mount(position_m=(0.0, 0.0, HEIGHT)), clutter_mean=0.0, ghosts=False)
    return dataclasses.replace(plain, **changes)


def frames(world: Any, drive: Any, radar: RadarConfig, count: int, first: int = 1) -> list[RadarScan]:
    """Consecutive scans of a radar, from frame number `first` on."""
    sensor = radar.build(world)
    scans = sensor.measure(drive, [(first + k) * STEP for k in range(count)])
    assert all(isinstance(scan, RadarScan) for scan in scans)
    return scans  # type: ignore[return-value]
