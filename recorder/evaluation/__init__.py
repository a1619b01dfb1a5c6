"""Trajectory errors: association, alignment, APE, RPE."""
