"""Faults of sensors: pure functions over samples, drawn by counter from seed, name and stamp."""
