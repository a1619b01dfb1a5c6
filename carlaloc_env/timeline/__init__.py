"""Motion of the ego, actors and lights over time, as sensors ask it."""
