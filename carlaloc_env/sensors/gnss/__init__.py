"""GNSS receivers and the satellites they see."""
