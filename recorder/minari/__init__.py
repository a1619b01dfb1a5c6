"""Recorded drives as Minari data sets."""
