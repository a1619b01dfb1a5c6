"""Stereo visual odometry of our own."""
