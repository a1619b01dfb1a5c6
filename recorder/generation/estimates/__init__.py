"""Estimates of time and size, made before the first byte is written."""
