"""Errors of SLAM systems against physical quantities: one swept at a time, with bands over seeds."""
