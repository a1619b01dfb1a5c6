"""LiDAR scans in weather: configurations and single scans of both clouds."""

from typing import Any

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.samples import PointCloud
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.weather.parameters import WeatherParameters

HEIGHT = 1.85
"""Height of the sensor above the ground [m]."""

POWER_MIN = 0.9 / 120.0**2
"""Weakest power that is found: a white wall at 120 m, as ρ/r²."""


def model(**changes: Any) -> Any:
    """The paper's LiDAR on the car, in weather and without range noise."""
    values = {"mount": Mount(position_m=(1.2, 0.0, HEIGHT)), "range_noise_m": 0.0, "weather": True}
    return LidarConfig(**{**values, **changes})


def semantic(
    world: Any, drive: Any, config: Any, weather: WeatherParameters, stamp_ns: int = 0
) -> PointCloud:
    """Semantic cloud of one scan in a weather."""
    world.weather = weather
    cloud = config.build(world).measure(drive, [stamp_ns])[1]
    assert isinstance(cloud, PointCloud)
    return cloud


def ranges(cloud: PointCloud) -> Array:
    """Distances of a cloud's points from the sensor [m], (N,)."""
    return np.linalg.norm(cloud.points_xyz_m.astype(np.float64), axis=-1)
