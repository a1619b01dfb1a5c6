"""Minari data sets of recorded drives."""
