"""Profiles of common wheels and gamepads, one YAML file each."""
