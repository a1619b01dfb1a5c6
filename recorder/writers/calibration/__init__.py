"""Calibration files of SLAM systems."""
