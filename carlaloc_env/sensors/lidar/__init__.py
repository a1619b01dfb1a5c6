"""The LiDAR: scan pattern, intensity, weather."""
