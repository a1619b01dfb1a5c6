"""What the examples of learning share: a route, a pupil, its sight, and how it is scored."""
