"""Physical constants that several parts of the program use."""

GRAVITY_MPS2 = 9.81
"""Acceleration of free fall, along −z of the world [m/s²]; in physics, IMU and written calibration alike."""
