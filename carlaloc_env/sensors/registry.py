"""All kinds of sensors by the name they have in YAML files; a new sensor is one line here."""

from carlaloc_env.sensors.base import SensorConfig
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.gnss import GnssConfig
from carlaloc_env.sensors.imu import ImuConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.sensors.radar_config import RadarConfig
from carlaloc_env.sensors.vehicle import SpeedConfig, WheelsConfig

SENSOR_KINDS: dict[str, type[SensorConfig]] = {
    "camera": CameraConfig,
    "lidar": LidarConfig,
    "radar": RadarConfig,
    "imu": ImuConfig,
    "gnss": GnssConfig,
    "speed": SpeedConfig,
    "wheels": WheelsConfig,
}
"""Configuration class of each kind of sensor."""
