"""Faults of a map, by element and line."""
