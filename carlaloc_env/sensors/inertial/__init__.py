"""The IMU: noise, bias, vibration."""
