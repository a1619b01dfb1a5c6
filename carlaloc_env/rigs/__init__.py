"""Sensor rigs: named presets, rig files, and their memory."""
