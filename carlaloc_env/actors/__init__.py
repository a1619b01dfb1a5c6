"""Models of all actors placed at one instant, for cameras and for rays."""
