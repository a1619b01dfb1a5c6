"""All kinds of sensors by the name they have in YAML files; a new sensor is one line here."""

from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.core.own_code import own_object
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


def config_class(kind: str) -> type[SensorConfig]:
    """Configuration class of a kind, or of a user's own, ``module:Class``.

    Raises:
        ConfigError: there is no such kind or class.
    """
    if kind in SENSOR_KINDS:
        return SENSOR_KINDS[kind]
    if ":" not in kind:
        raise ConfigError(unknown_name("kind of sensor", kind, SENSOR_KINDS) + ", or MODULE:CLASS")
    config = own_object(kind, type)
    if not issubclass(config, SensorConfig):
        raise ConfigError(f"{kind} is no SensorConfig; see examples/own_sensors")
    return config


def kind_word(config: SensorConfig) -> str:
    """The kind of a configuration as `config_class` finds it."""
    own = type(config)
    return config.kind if SENSOR_KINDS.get(config.kind) is own else f"{own.__module__}:{own.__qualname__}"
