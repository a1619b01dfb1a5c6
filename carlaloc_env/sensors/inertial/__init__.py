"""The IMU: noise and bias."""
