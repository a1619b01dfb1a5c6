"""Models of walkers: bodies, clothes, gait."""
