"""Curves, elevation and planes of maps."""
