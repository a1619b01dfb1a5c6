"""Experiments with SLAM systems: sweeps, breaking points, consistency, places, closed loops, maps."""
