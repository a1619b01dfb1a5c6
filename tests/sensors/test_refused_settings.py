"""Settings of sensors that cannot be are refused, each by its name."""

import math
from typing import Any

import pytest

from carlaloc_env.core.errors import ConfigError
from carlaloc_env.sensors.camera_config import CameraConfig, EventConfig, ImagerConfig, ShutterConfig
from carlaloc_env.sensors.gnss import GnssConfig
from carlaloc_env.sensors.imu import ImuConfig
from carlaloc_env.sensors.lidar_config import LidarConfig, ReceiverConfig
from carlaloc_env.sensors.radar_config import RadarConfig


@pytest.mark.parametrize(
    ("config", "wrong", "message"),
    [
        (CameraConfig, {"outputs": ("rgb", "thermal")}, "rgb, depth, semantic"),
        (CameraConfig, {"leaf_wind_mps": 80.0}, "leaf_wind_mps"),
        (CameraConfig, {"shutter": ShutterConfig()}, "needs an imager"),
        (ImagerConfig, {"exposure_min_ms": 0.0}, "exposure_min_ms"),
        (ImagerConfig, {"adc_bits": 4}, "adc_bits"),
        (ShutterConfig, {"readout_ms": -1.0}, "readout_ms"),
        (EventConfig, {"threshold_on": 0.0}, "at least 0.01"),
        (EventConfig, {"shot_hz": -1.0}, "must not be negative"),
        (EventConfig, {"restart_s": 0.0}, "above zero"),
        (GnssConfig, {"noise_enu_m": (1.0, -1.0, 1.0)}, "noise_enu_m"),
        (GnssConfig, {"model": "sattelites"}, "did you mean 'satellites'"),
        (GnssConfig, {"constellations": ("gallileo",)}, "did you mean 'galileo'"),
        (GnssConfig, {"mask_deg": 90.0}, "mask_deg"),
        (GnssConfig, {"slow_s": 0.0}, "correlation times"),
        (ImuConfig, {"orientation": "thruth"}, "did you mean 'truth'"),
        (ImuConfig, {"scale_error": -0.1}, "≥ 0"),
        (ImuConfig, {"accel_noise_density": -1.0}, "≥ 0"),
        (ImuConfig, {"gyro_random_walk": math.nan}, "≥ 0"),
        (LidarConfig, {"columns": 0}, "columns"),
        (LidarConfig, {"range_max_m": 0.5}, "range_min_m"),
        (LidarConfig, {"elevations_deg": (3.0, -3.0)}, "lowest"),
        (LidarConfig, {"elevations_deg": ()}, "elevations"),
        (LidarConfig, {"firing_ns": (0, 1)}, "firing_ns"),
        (LidarConfig, {"outputs": ("clouds",)}, "cloud"),
        (LidarConfig, {"sectors": -1}, "sectors"),
        (LidarConfig, {"dropoff_general": 1.5}, "drop-off"),
        (LidarConfig, {"dropoff_intensity_limit": 0.0}, "drop-off"),
        (LidarConfig, {"divergence_mrad": -1.0}, "divergence"),
        (ReceiverConfig, {"reach_m": 0.0}, "reach_m"),
        (ReceiverConfig, {"power_levels": 0}, "power_levels"),
        (ReceiverConfig, {"edge_rays": 17}, "edge_rays"),
        (ReceiverConfig, {"overload": 0.5}, "overload"),
        (RadarConfig, {"range_min_m": 0.0}, "range_min_m"),
        (RadarConfig, {"pfa": 0.95}, "pfa"),
        (RadarConfig, {"azimuth_fov_deg": 200.0}, "azimuth_fov_deg"),
        (RadarConfig, {"rays_per_actor": 0}, "rays_per_actor"),
        (RadarConfig, {"clutter_mean": -1.0}, "clutter_mean"),
        (RadarConfig, {"doppler_resolution_mps": 0.0}, "doppler_resolution_mps"),
    ],
)
def test_settings_that_cannot_be_are_refused(config: Any, wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        config(**wrong)
