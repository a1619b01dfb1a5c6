"""Ranges of the metrics of real recordings, measured by the same functions, with their sources."""

from __future__ import annotations

LIDAR_SOURCE = "HDL-32E: nuScenes (Caesar et al. 2020), two key frames; Koide, two turns"
PICTURE_SOURCE = "nuScenes; KITTI (Geiger et al. 2013); Boreas (Burnett et al. 2023)"
KITTI_SOURCE, COMMA_SOURCE = "KITTI, OXTS RT3003, two windows", "comma2k19 (Schafer et al. 2018), windscreen"
"""Recordings from which the ranges come."""
REAL_LIDAR = {
    "own car: share below 2.5 m": (0.10, 0.20),
    "no return, rings below -22 deg": (0.0, 0.10),
    "no return, rings at -4 to -1 deg": (0.15, 0.50),
    "range p99 [m]": (55.0, 80.0),
    "share beyond 70 m": (0.0, 0.015),
    "road residual, 1.5 m [cm]": (0.3, 0.8),
    "neighbours' correlation on the road": (0.05, 0.35),
    "shot noise, 0.55 m, p50 [cm]": (0.25, 0.55),
    "shot noise p10 [cm]": (0.15, 0.35),
    "dropouts at range discontinuities": (0.08, 0.18),
    "mixed pixels at range discontinuities": (0.02, 0.09),
    "intensity p50": (6.0, 15.0),
    "intensity p95": (40.0, 75.0),
    "ground intensity exponent": (-0.45, 0.3),
    "intensity variation in a road window": (0.08, 0.20),
}
"""Least and largest values of real sweeps."""
_KITTI = {
    "a_z 1-3 Hz": 0.20, "a_z 3-8 Hz": 0.06, "a_z 8-15 Hz": 0.03, "a_z 15-25 Hz": 0.02,
    "a_y 1-3 Hz": 0.09, "a_y 3-8 Hz": 0.03, "roll rate 1-3 Hz": 0.008,
}  # fmt: skip
_COMMA = {
    "a_z 1-3 Hz": 0.18, "a_z 3-8 Hz": 0.11, "a_z 8-15 Hz": 0.19, "a_z 15-25 Hz": 0.13,
    "a_y 1-3 Hz": 0.10, "a_y 3-8 Hz": 0.12, "roll rate 1-3 Hz": 0.009,
}  # fmt: skip
"""Root mean squares of two real cars, on a street and on a fast road [m/s², rad/s]."""
REAL_IMU = {
    **{f"{name} at 4-8 m/s": (0.5 * value, 2.0 * value) for name, value in _KITTI.items()},
    **{f"{name} at 16-20 m/s": (0.5 * value, 2.0 * value) for name, value in _COMMA.items()},
    "acceleration at rest": (0.009, 0.014),
}
"""Half to twice a real car's values: a class of ISO 8608 is twice as high as the one before it."""
