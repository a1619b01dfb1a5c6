"""LiDAR scans of the paper's sensor: both clouds, directions and poses of their points."""

from typing import Any

from carlaloc_env.samples import PointCloud
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.sensors.lidar_presets import HDL32E_ELEVATIONS_DEG, HDL32E_FIRING_NS

HEIGHT = 1.85
"""Height of the sensor above the ground [m]."""

MOUNT = Mount(position_m=(1.2, 0.0, HEIGHT))
"""The paper's mount on the car."""

HDL32E: dict[str, Any] = {
    "elevations_deg": HDL32E_ELEVATIONS_DEG,
    "firing_ns": HDL32E_FIRING_NS,
    "columns": 1085,
}


def paper(**changes: Any) -> Any:
    """The paper's LiDAR, changed as asked."""
    return LidarConfig(**{"mount": MOUNT, **changes})


def sweep(world: Any, drive: Any, config: Any, stamp_ns: int = 0) -> tuple[PointCloud, PointCloud]:
    """Plain and semantic cloud of one scan."""
    clouds = config.build(world).measure(drive, [stamp_ns])
    return clouds[0], clouds[1]
